"""Mission planning: cases, other solvers, proofs by labels."""
