"""Networks of our own, trained from pictures."""
