"""Running a plan on a bench: steps, states, and the engine that never loses a frame."""
