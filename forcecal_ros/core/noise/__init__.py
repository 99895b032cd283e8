"""Noise as a recording shows it: white or coloured, and what it makes of means and sums."""
