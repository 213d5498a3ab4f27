"""From light to digital numbers, in the quantities of EMVA 1288."""

from __future__ import annotations

import torch

from optics.camera import Sensor


def pixel_transfer(rows: int, columns: int, factor: int) -> torch.Tensor:
    """Transfer function of a full-fill square pixel on an rfft2 grid, float64.

    The grid has `factor` samples per pixel along each axis and its origin in the corner.
    """
    fy = torch.fft.fftfreq(rows, 1 / factor, dtype=torch.float64)[:, None]
    fx = torch.fft.rfftfreq(columns, 1 / factor, dtype=torch.float64)[None, :]
    return torch.sinc(fy) * torch.sinc(fx)


def sample_pixels(light: torch.Tensor, factor: int) -> torch.Tensor:
    """The samples at pixel centres of a grid that is `factor` times finer than the pixels.

    The origin stays at n // 2 for even and odd sizes.
    """
    rows, columns = (n // factor for n in light.shape[-2:])
    y = light.shape[-2] // 2 - (rows // 2) * factor
    x = light.shape[-1] // 2 - (columns // 2) * factor
    return light[..., y::factor, x::factor][..., :rows, :columns]


def integrate_pixels(light: torch.Tensor, factor: int) -> torch.Tensor:
    """Light on whole pixels, from (..., rows, columns) of light on `factor`² finer samples.

    Exact for light that the finer grid resolves, away from the edges: the pixel's
    aperture is applied in the frequency domain.
    """
    rows, columns = light.shape[-2:]
    transfer = pixel_transfer(rows, columns, factor).to(light)
    blurred = torch.fft.irfft2(torch.fft.rfft2(light) * transfer, s=(rows, columns))
    return sample_pixels(blurred, factor) * factor**2


def expose(
    rate: torch.Tensor,
    exposure: float,
    sensor: Sensor,
    generator: torch.Generator,
    *,
    shot_noise: bool = True,
    read_noise: bool = True,
    dark_current: bool = True,
) -> torch.Tensor:
    """One raw frame: (rows, columns) of digital numbers, int32.

    rate: photo-electrons per second and pixel. exposure: seconds. The stages stand in
    the order of the physics: dark current, shot noise, full well, read noise, gain and
    black level, quantisation and clipping.
    """
    if not exposure > 0:
        raise ValueError(f"exposure is {exposure:g} s; it must be positive")
    mean = rate.clamp(min=0) * exposure
    if dark_current:
        mean = mean + sensor.dark_current * exposure
    electrons = torch.poisson(mean, generator=generator) if shot_noise else mean
    electrons = electrons.clamp(max=sensor.full_well)
    if read_noise:
        noise = torch.randn(mean.shape, generator=generator, dtype=mean.dtype, device=mean.device)
        electrons = electrons + sensor.read_noise * noise
    number = torch.round(electrons / sensor.gain + sensor.black_level)
    return number.clamp(0, 2**sensor.bits - 1).to(torch.int32)
