"""The commands `labapp pattern` and `labapp retrieve`: write patterns with their predicted PSF."""
