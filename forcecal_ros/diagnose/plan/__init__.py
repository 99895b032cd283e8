"""A recording sequence for a diagnosis, and which effects it would show."""
