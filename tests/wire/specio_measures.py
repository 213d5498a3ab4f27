"""Run by another Python: one measurement by colour-specio's own driver, as JSON."""

import json
import sys
import warnings

warnings.simplefilter("ignore")

from specio._device_implementations.konica_minolta import CS2000  # noqa: E402

device = CS2000(sys.argv[1])
told = device._raw_measure()
result = {
    "model": device.model,
    "serial": device.serial_number,
    "exposure": told.exposure,
    "nanometres": [float(nm) for nm in told.spd.wavelengths],
    "values": [float(value) for value in told.spd.values],
}
print(json.dumps(result))
