"""Model light, modulators, lenses, sensors and their inverses, as functions on tensors.

Import what you need from each module. This package doesn't depend on files, devices or windows,
and importing it loads nothing else.
"""
