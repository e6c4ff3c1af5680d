"""Faults at every moment of work that writes: the process stopped, the disk full. ``python -m tests.faults --help``."""
