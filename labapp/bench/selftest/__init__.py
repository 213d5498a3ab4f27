"""Whether a device does what its interface says: a report that can be sent to support."""
