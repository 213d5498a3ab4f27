"""Pictures of a scene that are simulated without a run, and which effects they need."""
