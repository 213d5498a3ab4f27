"""What is known before anything is rendered: of the target, of the pattern."""
