"""Calibration of a bench, virtual or real: what to show, how to run it, what it says.

A calibration is an ordinary plan whose patterns lie beside it as pictures, run like any other,
and fits of its record. `designing` makes plan and patterns; `exposing` finds the exposure;
`frames` reads the record; `fitting` fits; `telling` and `pictures` say how it went; `in_force`
says whether a calibration still holds.
"""
