"""How much is explained, what is not, and how probable each cause is."""
