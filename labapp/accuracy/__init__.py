"""What accuracy costs in time, as work-precision diagrams of the machine at hand."""
