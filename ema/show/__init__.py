"""Nouns -> pictures; figures are returned, never shown or saved."""
