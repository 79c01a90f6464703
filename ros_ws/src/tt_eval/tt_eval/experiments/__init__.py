"""The experiments of Chapter 2 of the dissertation, and beyond, on rendered bursts: each prints its table and saves its figures."""
