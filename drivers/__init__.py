"""Interfaces of laboratory devices, and drivers of real ones.

This package imports neither optics nor simulator nor labapp; importing it loads nothing.
"""
