"""Read and write what labapp keeps: benches, plans, scenes, calibrations, designs and tables."""
