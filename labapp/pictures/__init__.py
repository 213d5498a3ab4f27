"""Merge, measure, restore and report recorded pictures; the networks that restoration uses."""
