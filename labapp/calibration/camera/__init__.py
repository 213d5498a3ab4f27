"""Calibration of a bench's camera: gain, noise, saturation, linearity, and defective pixels.

`exposure_search` finds the exposure that fills the pixels; `plan_design` makes the plan, which is
run like any other; `recorded_frames` reads its record, or that of the ready plan photon-transfer;
`calibrating` fits it; `result_report` and `overview_figure` present the results.
"""
