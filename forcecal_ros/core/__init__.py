"""Geometry, streams, noise and files: what every other package imports."""
