"""A webcam for a process of its own: it is made where the driver lives."""

import numpy as np
from uvc_camera_machine import UvcCameraMachine

from drivers.uvc import UVCCamera


def source(device):
    machine = UvcCameraMachine(
        lambda exposure: np.full((4, 6), round(exposure / 1e-4)), 6, 4, 250.0, pixel_format="Y16 "
    )
    return machine.source(device)


def camera(surroundings, **options):
    return UVCCamera(surroundings, source=source, **options)
