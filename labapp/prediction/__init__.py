"""PSFs, beams along the axis and simulated pictures, for the command line."""
