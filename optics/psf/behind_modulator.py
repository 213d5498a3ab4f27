"""Compute the PSF behind a modulator, with its unmodulated light, jitter and flicker."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import torch

from optics.camera import Camera
from optics.camera.pupil import pupil_amplitude
from optics.psf.operator import PSFOperator
from optics.slm.modulator import Modulator
from optics.validation import as_number, to_plain_numbers


def modulated_psf(
    operator: PSFOperator, modulator: Modulator, timed_fields: Iterable[tuple[float, torch.Tensor]]
) -> torch.Tensor:
    """Compute the PSF behind a modulator, with all that the modulator does to the light.

    It is the mean of the PSFs of all fields, weighted by their shares of time, plus the light that
    the pattern can't modulate. That light is added in intensity (thesis §5.6). Light that phase
    jitter scatters is spread like that of a single pixel (see `Modulator.jitter_scatter_share`).
    Differentiable in the fields.

    Parameters
    ----------
    operator : PSFOperator
        The operator of a camera with the modulator's panel, at the modulator's wavelength. Plan it
        with ``unmodulated=0``: the modulator knows that share.
    modulator : Modulator
        The panel at a wavelength.
    timed_fields : iterable of (float, torch.Tensor)
        Shares of time and complex fields (rows, columns) of the panel, at least one pair. They are
        what `Modulator.still_fields` gives, or `Modulator.video_cycle_fields` without its frame
        numbers.

    Returns
    -------
    torch.Tensor
        The share of the light that each of the operator's pixels receives, (rows, columns).

    Raises
    ------
    ValueError
        If there are no fields, if the operator adds unmodulated light itself, if it is of a lens
        alone, or if it belongs to another panel or wavelength.

    References
    ----------
    Thesis §5.6.
    """
    camera = _require_matching_camera(operator, modulator)
    scattered, time = modulator.jitter_scatter_share, 0.0
    light: torch.Tensor | None = None
    for share, field in timed_fields:
        part = operator(None, field)
        if scattered:
            part = (1 - scattered) * part + scattered * _jitter_scattered_psf(
                operator, camera, field
            ).to(part)
        light = share * part if light is None else torch.add(light, part, alpha=share)
        time += share
    if light is None:
        raise ValueError("timed_fields is empty; give one share of time and its field at least")
    light = (1 - modulator.unmodulated_share) * light
    for share, straight in modulator.unmodulated_fields:
        # Unmodulated light is the same for every pattern, so the operator caches its PSF.
        psf = operator.unmodulated_psf(straight, cache_result=True).to(light)
        light = torch.add(light, psf, alpha=time * share)
    return light


def _jitter_scattered_psf(
    operator: PSFOperator, camera: Camera, field: torch.Tensor
) -> torch.Tensor:
    """Compute the light of panel pixels with random, independent phases."""
    lens, side = camera.lens, camera.panel.active_side
    scale = operator.scale
    y, x = (c.to(field.device) * (side / scale) for c in operator.pixels.mesh())
    area = operator.pixels.pitch[0] * operator.pixels.pitch[1]
    one = (torch.sinc(y) * torch.sinc(x)) ** 2 * (area * side**2 / scale**2)
    # A panel pixel that the stop covers in part counts as a full-size pixel that is dimmer.
    opened = pupil_amplitude(replace(camera, lens=to_plain_numbers(lens))).to(field.device)
    power = ((field.real**2 + field.imag**2) * opened**2).sum((-2, -1)) / opened.sum()
    return power[..., None, None] * one


def _require_matching_camera(operator: PSFOperator, modulator: Modulator) -> Camera:
    """Return the operator's camera; raise ValueError if the modulator doesn't match it."""
    camera, panel = operator.camera, modulator.panel
    if camera is None:
        raise ValueError("operator is of a lens alone; plan it for a camera with the panel")
    if (camera.panel.plane, camera.panel.fill_factor) != (panel.plane, panel.fill_factor):
        raise ValueError(
            f"operator's panel has {camera.panel.shape} pixels of {camera.panel.pitch:g} m and the "
            f"modulator's {panel.shape} of {panel.pitch:g} m; plan it for the same panel"
        )
    wavelength = as_number(operator.wavelength)
    if not math.isclose(wavelength, modulator.wavelength):
        raise ValueError(
            f"operator is planned for {wavelength * 1e9:g} nm and the modulator for "
            f"{modulator.wavelength * 1e9:g} nm; take the same wavelength"
        )
    if operator.unmodulated:
        raise ValueError(
            f"operator adds {operator.unmodulated:g} of unmodulated light itself, and the "
            "modulator would again; plan it with unmodulated=0"
        )
    return camera
