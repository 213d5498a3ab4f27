"""The command `labapp export`: write frames of a record to files that other programs read."""

from __future__ import annotations

from labapp.runs.export.command import export_record
from labapp.runs.export.exporting import KINDS, export_frames
from labapp.runs.export.frame_selection import FrameSelection

__all__ = ["KINDS", "FrameSelection", "export_frames", "export_record"]
