"""Self-test of a device: check that it does what its interface says, and report for support."""
