"""Warps: the node lattice, its interpolant, composition, continuation and validity."""
