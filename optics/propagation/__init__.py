"""Light in free space: one file a method, the cheapest of them that keeps a tolerance."""
