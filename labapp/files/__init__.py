"""The files that people write: bench, plan and scene."""
