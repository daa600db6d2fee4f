"""Liberties with rounding that compiled functions take, for numba's `fastmath`."""

REORDERED = {"contract", "reassoc"}
"""Sums may be taken in any order, and products added in one operation, which changes rounding alone, so that
the compiler vectorises them."""
