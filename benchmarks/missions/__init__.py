"""Mission planning: cases and other solvers."""
