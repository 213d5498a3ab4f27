"""From the target PSF to a phase pattern."""
