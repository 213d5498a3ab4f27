"""A filter of one's own: it follows drivers.interfaces.SpectralFilter, and that is all."""

from drivers.errors import DeviceError
from drivers.interfaces import Identity, Setting


class ExampleWheel:
    """Two colours. settling_ms: until one stands."""

    reply_time = 0.5
    bandwidth = 10e-9
    wavelength_range = (500e-9, 600e-9)

    def __init__(self, surroundings, settling_ms=10.0):
        if settling_ms < 0:
            raise ValueError(f"settling_ms is {settling_ms}; it must not be negative")
        self._clock = surroundings.clock
        self.settling = settling_ms * 1e-3
        self.wavelength = 500e-9

    @property
    def identity(self):
        return Identity("example wheel", "1", simulated=False)

    def health(self):
        return {"colours": "2"}

    def set_wavelength(self, wavelength):
        low, high = self.wavelength_range
        if not low <= wavelength <= high:
            raise DeviceError("example wheel", "tune", "out of range", "Choose 500 to 600 nm")
        self.wavelength = round(wavelength * 1e11) / 1e11
        return Setting(wavelength, self.wavelength, self._clock.now() + self.settling)

    def make_safe(self):
        self.set_wavelength(500e-9)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.make_safe()
