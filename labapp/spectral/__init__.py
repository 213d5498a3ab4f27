"""Restoring bands from coded photographs, judging them against the truth, and showing their colours
in a chosen light.
"""
