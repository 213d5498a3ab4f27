"""Read and write the application's files: bench, plan, scene, calibration, design and tables."""
