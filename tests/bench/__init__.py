"""Benchmarks: cases with known truth, their scores, and the peers they are compared with."""
