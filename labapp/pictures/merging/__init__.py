"""The command `labapp merge`: exposure brackets from files or a record to radiance."""
