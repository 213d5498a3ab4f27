"""`labapp export`: frames of a record as files that other programs read."""

from __future__ import annotations

from labapp.export.choosing import Choice
from labapp.export.command import export_record
from labapp.export.exporting import export
from labapp.export.formats import KINDS

__all__ = ["KINDS", "Choice", "export", "export_record"]
