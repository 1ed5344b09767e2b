"""What is computed from the equations: compiled functions, the implicit integrator, smoothing."""
