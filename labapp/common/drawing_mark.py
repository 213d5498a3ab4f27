"""The words in a picture file by which labapp knows its own drawings again."""

DRAWING = "Drawn by labapp to look at"
"""Value of the text "Description" in a .png that shows numbers and doesn't hold them."""
