"""Train networks and patterns: one loop for all, and what is trained."""
