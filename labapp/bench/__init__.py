"""Benches: opened and locked together, checked, tried, and virtual ones behind true wires."""
