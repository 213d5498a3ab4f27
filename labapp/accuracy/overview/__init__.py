"""What accuracy costs in every operation of labapp, measured and written as one page."""
