"""Self-test of a device: whether it does what its interface says, and a report for support."""
