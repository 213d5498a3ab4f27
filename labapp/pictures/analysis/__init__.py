"""Merged frames of a record, PSFs and colours measured on them, and scores of restorations."""
