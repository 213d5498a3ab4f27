"""Instruments as their manuals describe them: bytes or USB transfers in, answers out."""
