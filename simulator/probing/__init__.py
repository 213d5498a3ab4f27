"""Probe the target's picture, the pattern and the lens for numbers before anything is rendered."""
