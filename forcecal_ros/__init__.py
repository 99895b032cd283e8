"""Self-calibrating force sensing for robots: identify, observe, diagnose."""

__version__ = '0.1.0'
