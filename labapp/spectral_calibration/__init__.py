"""Calibration of a snapshot spectral camera: PSFs and response of each band, and the lamp's light.

`request` says what is asked for. `exposure_search` finds exposures by trial, `plan_design` makes
the plan, `radiances` measures the light with a spectroradiometer, and `fitting` fits the record's
frames, beginning at the camera as it is meant to be. The steps, and the content of spectra.json,
are those of `calibrating`; `overview_figure` draws it.
"""
