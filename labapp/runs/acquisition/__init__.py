"""Execute a plan on a bench: take each planned frame, and store it in the record."""
