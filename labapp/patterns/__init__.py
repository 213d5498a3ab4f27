"""Grey levels of a plan's patterns on the SLM's panel, and the design of patterns."""
