"""What is sent to a panel's screen: set right, refused, told, put back, and looked at again."""

from __future__ import annotations

import logging

import numpy as np
import pytest
from figures.connector_properties import connector

from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.interfaces import Surroundings
from drivers.screen import ScreenSLM
from drivers.x11 import XConnection
from drivers.x11.outputs import list_outputs

pytestmark = [pytest.mark.xvfb, pytest.mark.usefixtures("patient")]

SHAPE = (120, 160)
BROADCAST = ["Automatic", "Full", "Limited 16:235"]
BLUISH = [0, 1, *[0] * 7, 1, *[0] * 6, 1 << 30, 0]


@pytest.fixture
def output(server):
    """The server's only connector, whose properties are deleted after the test."""
    with XConnection(server.display) as x:
        number = list_outputs(x)[0].number
    with connector(server.display, number) as made:
        yield made


def told(server) -> dict[str, str]:
    """The properties as xrandr tells them."""
    lines = server.xrandr("--prop").split("\n")
    pairs = (line.strip().split(": ", 1) for line in lines if line.startswith("\t"))
    return {pair[0]: pair[1].strip() for pair in pairs if len(pair) == 2 and pair[0] != "supported"}


def opened(server, **options):
    given = {"width": 160, "height": 120, "display": server.display, "allow_primary": True}
    return ScreenSLM(Surroundings(RealClock()), **{**given, **options})


def noise(rng, *frames):
    return rng.integers(0, 256, (*frames, *SHAPE), np.uint8)


def test_what_alters_levels_is_set_told_and_put_back(server, output, caplog):
    output.make("Broadcast RGB", BROADCAST, "Limited 16:235")
    output.make("max bpc", [6, 16], [6], is_range=True)
    output.make("CTM", [], BLUISH)
    output.make("scaling mode", ["None", "Full"], "None")
    output.make("of its own", [0, 9], [4], is_range=True)
    with opened(server) as slm:
        during = told(server)
        assert "Broadcast RGB Full" in slm.health()["connector"]
    assert (during["Broadcast RGB"], during["max bpc"]) == ("Full", "8")
    assert during["CTM"].startswith("0 1 0 0 0 0 0 0 0 1 0 0 0 0 0 0")
    assert during["of its own"] == "4"
    for words in ("Broadcast RGB is set from Limited 16:235 to Full", "max bpc", "CTM is set"):
        assert len([line for line in caplog.messages if words in line]) == 1, words
    after = told(server)
    assert (after["Broadcast RGB"], after["max bpc"]) == ("Limited 16:235", "6")
    assert after["scaling mode"] == "None"


def test_what_others_have_set_meanwhile_is_left_to_them(server, output):
    output.make("dither", ["off", "on"], "on")
    with opened(server):
        assert told(server)["dither"] == "off"
        output.set("dither", "on")
    assert told(server)["dither"] == "on"
    output.set("dither", "off")
    with opened(server):
        pass
    assert told(server)["dither"] == "off"


def test_what_cannot_be_set_is_refused_unless_it_is_allowed(server, output):
    output.make("max bpc", [6, 7], [6], is_range=True)
    for name in ("dither", "underscan"):
        output.make(name, ["off", "on"], "on")
    with (
        pytest.raises(
            DeviceError, match=r"max bpc at 6: a colour has fewer than 8 bits.*allow_pro"
        ),
        opened(server),
    ):
        pass
    # What was set before something else was refused is put back, too.
    assert [told(server)[name] for name in ("dither", "underscan")] == ["on", "on"]
    with opened(server, allow_properties=["Max BPC"]) as slm:
        assert slm.displayed_pattern == "neutral"
    assert told(server)["max bpc"] == "6"


@pytest.mark.parametrize("shown", ["still", "video"])
def test_a_change_while_a_pattern_stands_is_named_until_one_is_shown_again(
    server, output, rng, shown, caplog
):
    output.make("Broadcast RGB", BROADCAST, "Full")
    output.make("max bpc", [6, 16], [8], is_range=True)
    output.make("of its own", [0, 9], [4], is_range=True)

    def show(slm):
        slm.show("it", noise(rng)) if shown == "still" else slm.play("it", noise(rng, 3))

    with opened(server) as slm:
        for change, words in (
            (lambda: output.set("Broadcast RGB", "Limited 16:235"), "RGB changed from Full to Lim"),
            (lambda: output.set("of its own", [5]), "of its own changed from 4 to 5"),
            (lambda: output.make("CTM", [], BLUISH), "CTM changed .*mixed by a matrix"),
            (lambda: output.delete("max bpc"), "max bpc changed from 8 to absent"),
        ):
            show(slm)
            assert slm.displayed_pattern == "it"
            change()
            for _ in range(2):
                with pytest.raises(DeviceError, match=words):
                    slm.displayed_pattern  # noqa: B018
        show(slm)
        assert slm.displayed_pattern == "it"
        assert told(server)["Broadcast RGB"] == "Full"
    assert "is set from Limited 16:235 to Full" in caplog.text


def test_a_change_that_was_over_before_anybody_looked_is_named(server, output, rng):
    output.make("Broadcast RGB", BROADCAST, "Full")
    output.make("Content Protection", ["Undesired", "Desired"], "Undesired")
    with opened(server) as slm:
        slm.show("it", noise(rng))
        output.set("Content Protection", "Desired")
        assert slm.displayed_pattern == "it"
        output.set("Broadcast RGB", "Limited 16:235")
        output.set("Broadcast RGB", "Full")
        with pytest.raises(DeviceError, match="Broadcast RGB was set by another program"):
            slm.displayed_pattern  # noqa: B018


def test_a_screen_with_sound_properties_is_left_alone(server, output, rng, caplog):
    output.make("Broadcast RGB", BROADCAST, "Full")
    output.make("max bpc", [6, 16], [12], is_range=True)
    output.make("CTM", [], [0, 1, *[0] * 7, 1, *[0] * 7, 1])
    output.make("color vibrance", [0, 200], [150], is_range=True)
    before = told(server)
    with opened(server) as slm:
        slm.show("it", noise(rng))
        assert slm.displayed_pattern == "it"
        assert told(server) == before
    assert not [record for record in caplog.records if record.levelno >= logging.WARNING]
