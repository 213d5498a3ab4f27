"""`labapp refine`: correct a design by the PSF that the bench's camera measures.

The SLM shows the frames of a design file, and the camera photographs their PSF. The picture is
resampled to the design grid, where it replaces the computed PSF in the iterations
(optics.retrieval.camera_feedback). `start` reads the design, `sensor_view` maps the design grid to
the sensor, and `psf_measurement` takes and measures a picture. `result` and `refinement_picture`
hold and show the outcome.
"""
