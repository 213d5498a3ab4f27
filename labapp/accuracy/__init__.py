"""What accuracy costs in time: work-precision diagrams, measured on the machine at hand."""
