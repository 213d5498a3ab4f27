"""What becomes of pictures: merged, measured, restored, reported; networks that learn from them."""
