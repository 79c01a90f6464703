"""The experiments of Chapter 2 of the dissertation, and of its limits, on rendered bursts; each prints a table and saves figures."""
