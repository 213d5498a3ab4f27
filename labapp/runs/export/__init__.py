"""The command `labapp export`: write frames of a record to files that other programs read."""

from __future__ import annotations

from labapp.runs.export.exporting import KINDS, FrameSelection, export_frames, export_record

__all__ = ["KINDS", "FrameSelection", "export_frames", "export_record"]
