"""What every room uses: errors and tables for a person, memory, times."""
