"""Restore a blurred photograph: read its files, restore it, and show before and after."""
