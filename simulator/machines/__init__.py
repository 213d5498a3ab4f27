"""Simulated instruments as they are on their wire: they know neither ports nor worlds."""
