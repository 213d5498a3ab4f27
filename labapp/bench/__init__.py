"""Open, lock, check and test the devices of a bench, and serve virtual benches to real drivers."""
