"""Compute the grey levels of a plan's patterns on the SLM's panel, and design patterns."""
