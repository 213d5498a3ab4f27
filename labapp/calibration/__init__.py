"""Calibration of a bench, virtual or real, by an ordinary plan with its patterns as picture files.

It is run like any other plan; its record is then fitted. `plan_design` makes plan and patterns;
`exposure_search` finds the exposure; `calibration_frames` reads the record; `fitting` fits it;
`result_report` and `overview_figure` present the results. `labapp.bench.calibration_validity`
checks whether a calibration still holds.
"""
