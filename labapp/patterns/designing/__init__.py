"""`labapp pattern` and `labapp retrieve`: patterns as files, with the PSF that they will give."""
