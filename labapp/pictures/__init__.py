"""Merge, measure, restore and report recorded pictures, and train the networks for restoration."""
