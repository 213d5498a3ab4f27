"""Pictures of scenes without a run: which effects they call for, and what they look like."""
