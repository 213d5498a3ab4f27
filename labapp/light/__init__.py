"""What light does, as a person asks for it: PSFs, beams, pictures of the simulator."""
