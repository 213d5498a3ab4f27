"""Simulated serial instruments: bytes in, bytes out, and the time."""
