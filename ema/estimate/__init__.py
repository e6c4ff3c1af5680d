"""Recording -> FrfSet."""
