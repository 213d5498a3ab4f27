"""Serial instruments as their manuals describe them: bytes in, bytes out."""
