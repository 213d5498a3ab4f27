"""Share helpers among the packages of labapp: errors, terminal output, memory, machine speed."""
