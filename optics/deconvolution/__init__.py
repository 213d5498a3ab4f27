"""Undoing a known blur."""
