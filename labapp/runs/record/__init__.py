"""The record of a run: one self-describing HDF5 file, readable while it is written."""
