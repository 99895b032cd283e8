"""Recordings: signals over time, and the files they come from."""
