"""Pictures whose numbers mean something else than colours: patterns, maps and masks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from labapp.common.console import print_message
from labapp.common.errors import UserError

if TYPE_CHECKING:
    from numpy.typing import NDArray

CHANNELS = ("red", "green", "blue")


def read_grey_picture(
    path: Path, use: str, *, channel: str | None = None, remedy: str = ""
) -> NDArray[Any]:
    """Read grey numbers as they are stored, (rows, columns).

    use: what the picture is, in words.
    channel: of `CHANNELS`, the one to take of a colour picture; without it, colours that differ are
    refused.
    remedy: how the command's reader names a channel.
    A compression that has changed the numbers is told. Raises UserError.
    """
    from labapp.files.picture.encoding import LINEAR
    from labapp.files.picture.photograph import read_photograph

    picture = read_photograph(path, encoding=LINEAR)
    if picture.is_lossy:
        print_message(
            f"note: {path}: is a {picture.kind}, whose compression changes numbers: {use} isn't "
            "shown as it was drawn. Save it as PNG."
        )
    bands = picture.levels
    if channel is not None:
        if len(bands) == 1:
            raise UserError(f"{path}: is grey. Leave the channel {channel!r} out.")
        return bands[CHANNELS.index(channel)]
    first, *others = bands
    if any((one != first).any() for one in others):
        raise UserError(
            f"{path}: is in colour, and {use} has one number a pixel. Save it in grey{remedy}."
        )
    return first
