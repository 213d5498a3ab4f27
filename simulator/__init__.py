"""The virtual bench: simulated scenes, optical effects and devices.

The simulator may import `optics` and `drivers`, but not `labapp`. Importing this package loads
none of its modules.
"""
