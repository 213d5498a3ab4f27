"""Simulated instruments behind the wire: the unmodified drivers talk to them."""
