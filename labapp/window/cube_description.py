"""Words that describe a restored cube to a person."""

from __future__ import annotations

import math

from labapp.window.spectral_messages import CubeColours, CubeQuality, SpectralResult


def describe_cube(result: SpectralResult, colours: CubeColours) -> str:
    """Describe a restored cube in a few sentences."""
    return (
        f"{result.source}: {len(result.wavelengths)} bands by {result.method}, "
        f"{result.iterations} iterations in {result.cpu_seconds:.2f} s of processor time. White is "
        f"{result.white}. {_describe_scores(result.quality, colours)}Noise {result.noise:.3g} "
        f"electrons per second. Residual {result.residual:.2f} of the noise, {result.verdict}."
    )


def _describe_scores(quality: CubeQuality | None, colours: CubeColours) -> str:
    """Describe how far a cube is from the true one; nothing if that isn't known."""
    if quality is None:
        return ""
    words = [
        f"PSNR {quality.mean_psnr:.1f} dB and SSIM {quality.mean_ssim:.3f}, means of the bands"
    ]
    if math.isfinite(quality.angle):
        words.append(f"spectral angle {quality.angle:.1f}°")
    if colours.difference is not None:
        words.append(
            f"CIEDE2000 {colours.difference:.1f} in {colours.light}, "
            f"{colours.largest_difference:.1f} at 95 % of the pixels"
        )
    return f"Against {quality.truth or 'the true cube'}: {'; '.join(words)}. "
