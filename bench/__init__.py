"""Benchmarks: the peer solver and the comparisons that `make bench` prints."""
