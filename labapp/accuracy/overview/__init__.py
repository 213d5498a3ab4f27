"""Measure what accuracy costs in every operation of labapp, and write it as one page."""
