"""Pictures from anywhere: what a file's bytes say of themselves, and the light they stand for."""
