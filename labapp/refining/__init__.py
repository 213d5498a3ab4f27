"""Corrections by what the bench's camera sees: `labapp refine`.

A design file's frames are shown, their PSF is photographed, laid on the design grid, and takes
the place of the computed one (optics.retrieval.camera_feedback). `start` reads the design; `exposing`
takes a picture as an ordinary run; `view` knows where the design grid lies on the sensor;
`watching` puts the three together; `result`, `picture` and `telling` are what is left of it.
"""
