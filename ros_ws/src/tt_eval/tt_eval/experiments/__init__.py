"""The experiments of Chapter 2 of the dissertation, and one on their limits, on rendered images. Each prints a table and saves figures."""
