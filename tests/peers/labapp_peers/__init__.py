"""Adapters to other libraries, which `labapp accuracy --peers` measures beside labapp."""
