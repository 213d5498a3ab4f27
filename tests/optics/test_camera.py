import math

import pytest

from optics.camera import Camera, Lens, Panel, Sensor


def test_the_image_distance_obeys_the_thin_lens_equation():
    """1/z = 1/f - 1/d by hand: f = 0.1 m focused at 0.3 m makes z = 0.15 m."""
    assert Lens(0.1, 4.0, 0.3).image_distance == pytest.approx(0.15)
    assert Lens(0.1, 4.0, math.inf).image_distance == pytest.approx(0.1)
    assert Lens(0.1, 4.0).stop_diameter == pytest.approx(0.025)


def test_full_scale_is_the_converter_or_the_well_whichever_is_lower():
    """10 bits end at 1023. A well of 1000 e- ends at 50 + 1000 / 2 = 550, less what
    read noise may take: a full well must never read as an unclipped value."""
    assert Sensor(bits=10, full_well=1e6).full_scale == 1023
    assert (
        Sensor(bits=12, full_well=1000.0, gain=2.0, black_level=50.0, read_noise=0.0).full_scale
        == 550
    )
    noisy = Sensor(bits=12, full_well=1000.0, gain=2.0, black_level=50.0, read_noise=4.0)
    assert 535 <= noisy.full_scale <= 542


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Panel(pitch=0.0), r"pitch is 0 m; it must be positive and finite"),
        (lambda: Panel(pitch=math.inf), r"pitch is inf"),
        (lambda: Panel(fill_factor=1.2), r"fill_factor is 1.2; .*between 0 and 1"),
        (lambda: Panel(fill_factor=0.0), r"fill_factor is 0"),
        (lambda: Panel(unmodulated=-0.1), r"unmodulated is -0.1; .*between 0 and 1"),
        (lambda: Panel(reflectivity=math.nan), r"reflectivity is nan"),
        (lambda: Panel(levels=1), r"levels is 1; .*at least 2"),
        (lambda: Panel(levels=1024), r"levels is 1024; .*256"),
        (lambda: Panel(shape=(0, 4)), r"shape \(0, 4\)"),
        (lambda: Panel(max_phase=()), r"max_phase is empty"),
        (lambda: Lens(focal_length=-0.1), r"focal_length is -0.1 m; it must be positive"),
        (lambda: Lens(f_number=0.0), r"f_number is 0;"),
        (lambda: Lens(focus_distance=0.1), r"focus_distance is 0.1 m; .*longer than the focal"),
        (lambda: Lens(focus_distance=math.nan), r"focus_distance is nan"),
        (lambda: Sensor(gain=0.0), r"gain is 0"),
        (lambda: Sensor(full_well=-1.0), r"full_well is -1"),
        (lambda: Sensor(bits=0), r"bits is 0; .* 1 to 16"),
        (lambda: Sensor(bits=17), r"bits is 17"),
        (lambda: Sensor(read_noise=-1.0), r"read_noise is -1"),
        (lambda: Sensor(dark_current=math.nan), r"dark_current is nan"),
        (lambda: Sensor(black_level=5000.0), r"black_level is 5000"),
        (lambda: Sensor(shape=(4, 0)), r"shape \(4, 0\)"),
        (lambda: Camera(transmission=2.0), r"transmission is 2; .*between 0 and 1"),
    ],
)
def test_a_description_that_no_camera_fits_is_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()
