"""Instruments behind their wires: they answer bytes or USB transfers as their manuals say."""
