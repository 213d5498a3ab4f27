"""The engine: light, modulators, lenses, sensors and their inverses, as functions on tensors.

Files stand in the order in which light meets them; import what you need from each.
This package knows no files, no devices and no windows, and importing it loads nothing.
"""
