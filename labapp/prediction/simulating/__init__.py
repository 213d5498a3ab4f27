"""Simulate pictures of a scene without a run, and explain which effects they need."""
