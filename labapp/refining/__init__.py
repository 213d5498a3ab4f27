"""Corrections by what the bench's camera sees: `labapp refine`.

A design file's frames are shown, their PSF is photographed, laid on the design grid, and takes
the place of the computed one (optics.retrieval.camera_feedback). `start` reads the design;
`psf_exposure` takes a picture as an ordinary run; `sensor_view` knows where the design grid lies
on the sensor; `psf_measurement` puts the three together; `result`, `refinement_picture` and
`refinement_report` are what is left of it.
"""
