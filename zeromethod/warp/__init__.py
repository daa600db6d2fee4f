"""Warps: the node lattice, its interpolant, and what one frame's loop does to a warp."""
