"""Train a pattern for an extended depth of field with its decoder, on scenes of many depths."""
