"""The lattice sensor of the paper: picked lattice points, one line of equations, a depth profile."""
