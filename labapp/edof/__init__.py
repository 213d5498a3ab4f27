"""Design patterns for an extended depth of field, and show what they reach beside the bound."""
