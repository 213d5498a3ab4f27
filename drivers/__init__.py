"""What each kind of laboratory device can do, and the code that drives real ones.

This package imports neither optics nor simulator nor labapp; importing it loads nothing.
"""
