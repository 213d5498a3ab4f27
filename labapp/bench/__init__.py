"""Opening, locking, checking and testing devices together, and serving virtual ones to drivers."""
