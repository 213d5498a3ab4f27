"""Restore, judge and show spectral cubes from coded snapshots of a record."""
