"""Calibration of a bench, virtual or real: what to show, how to run it, what it says.

A calibration is an ordinary plan whose patterns lie beside it as pictures, run like any other,
and fits of its record. `plan_design` makes plan and patterns; `exposure_search` finds the exposure;
`calibration_frames` reads the record; `fitting` fits; `result_report` and `overview_figure` say how
it went; `labapp.bench.calibration_validity` says whether a calibration still holds.
"""
