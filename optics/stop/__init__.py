"""The open area of a stop: its boundary, its share of every cell, exact integrals over it."""
