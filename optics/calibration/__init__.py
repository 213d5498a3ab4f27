"""Calibration of a modulator on its bench: fits on arrays, each with residual and uncertainty.

One file an idea: gratings to show; spots in a frame; from spots to the registration of panel
and sensor; from a sweep of levels to the phase response; from pictures of the star to wavefront
and focus; what stays in the centre.
"""
