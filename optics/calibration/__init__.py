"""Calibrate a panel (SLM) on its bench by fits, each with its residual and uncertainty.

There is one module for each step: the gratings to show; spots in a frame; the registration of
panel and sensor from spots; the phase response from a sweep of levels; wavefront and focus from
pictures of the star; the zeroth order.
"""
