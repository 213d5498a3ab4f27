"""What all packages of labapp use: errors, output in the terminal, memory, machine speed."""
