"""Calibration of a snapshot spectral camera: PSFs and response of each band, and the lamp's light.

`request` says what is asked for. `exposure_search` finds exposures by trial, `plan_design` makes
the plan, `radiances` measures the light with a spectroradiometer, `nominal_model` computes the
camera as it is meant to be, and `fitting` fits the record's frames. `spectra_tables`,
`result_report` and `overview_figure` present the results. The steps are those of `calibrating`.
"""
