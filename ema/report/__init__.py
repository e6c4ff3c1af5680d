"""Results -> sections -> HTML."""
