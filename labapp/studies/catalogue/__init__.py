"""Definitions and settings of the studies, without the imports that carrying them out needs."""
