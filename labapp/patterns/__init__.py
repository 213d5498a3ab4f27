"""Patterns: their grey levels on a panel, and their designs."""
