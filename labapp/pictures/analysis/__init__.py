"""Merge the frames of a record, measure PSFs from them, and score restored pictures."""
