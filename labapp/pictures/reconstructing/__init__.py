"""Undoing the blur of a person's photograph: from files to before and after."""
