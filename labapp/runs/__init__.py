"""Runs: planned, taken, recorded, resumed, verified, shown and exported."""
