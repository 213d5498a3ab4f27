"""All patterns of a plan file whose phase is given by a formula."""

from __future__ import annotations

# A class is one of FormulaPattern's subclasses once its module is imported.
from labapp.files import depth_table, phase_table, trained_table  # noqa: F401
from labapp.files.phase_table import FormulaPattern

FORMULA_PATTERNS = tuple(FormulaPattern.__subclasses__())
"""All formula patterns, in the order in which they are listed and offered."""
