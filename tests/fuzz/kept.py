"""Inputs that once failed."""


def replay():
    return []
