"""`labapp export`: frames of a record as files that other programs read."""

from __future__ import annotations

from labapp.runs.export.choosing import Choice
from labapp.runs.export.command import export_record
from labapp.runs.export.exporting import KINDS, export

__all__ = ["KINDS", "Choice", "export", "export_record"]
