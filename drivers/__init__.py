"""What a device can be asked for, and the real devices.

This package knows neither optics nor simulator nor labapp; importing it loads nothing.
"""
