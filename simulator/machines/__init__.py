"""Simulated instruments behind their wires: they answer bytes or USB transfers by their manuals."""
