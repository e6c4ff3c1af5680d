"""Mutated files of every format, each with its truth. ``python -m tests.fuzz --help``."""
