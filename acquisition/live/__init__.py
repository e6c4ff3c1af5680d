"""Rigs that measure now."""
