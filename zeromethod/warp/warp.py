"""The warp: per camera node, the LCD position that the node looks at."""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from zeromethod.arrays import Flags, Float, Mask, Single
from zeromethod.rig.geometry import GeometrySpec


@cache
def _exact(shape: tuple[int, ...]) -> tuple[Float, Flags]:
    """Sigma and flags of a warp of that shape that is known exactly, read-only."""
    return np.broadcast_to(np.float64(0.0), shape), np.broadcast_to(np.uint16(0), shape[:-1])


class Role(enum.StrEnum):
    """Which of the loop's three warps a warp is."""

    MEASURED = "measured"  # by one frame, at its mid-exposure
    COMMANDED = "commanded"  # what the controller wants shown next
    SHOWN = "shown"  # what was lit while a frame was exposed


@dataclass(frozen=True, slots=True, repr=False)
class Warp:
    """LCD position per node of a `NodeGrid`.

    Attributes
    ----------
    q : (rows, cols, 2) float64
        LCD (column, row), px, pixel centres at integers.
    sigma : (rows, cols, 2) float64
        Standard deviation of q, LCD px; 0 where q was drawn, not measured.
    flags : (rows, cols) uint16
        Bits of `Flag`; 0 = valid.
    time_ns : int
        Mid-exposure of the frame (measured, shown), or of the newest frame behind it
        (commanded).
    role : Role
        Measured by a frame, commanded by the controller, or shown while a frame was exposed.
    left : (rows, cols, 2) float32, optional
        Of a measured warp: how far the frame was from its null, LCD px (`with_left`); NaN at nodes that were
        not read by the carrier. None: not known.
    left_open : GeometrySpec, optional
        What the zero that was subtracted leaves open of depth, in every frame alike.
    """

    q: Float
    sigma: Float
    flags: Flags
    time_ns: int
    role: Role = Role.MEASURED
    left: Single | None = None
    left_open: GeometrySpec | None = None

    @classmethod
    def drawn(cls, q: Float, role: Role, time_ns: int) -> Warp:
        """Warp that is known exactly because it was drawn; sigma and flags are read-only zeros.

        Parameters
        ----------
        q : (rows, cols, 2) float64
            LCD positions, px.
        role : Role
            Commanded or shown.
        time_ns : int
            See `Warp`.

        Returns
        -------
        Warp
            The warp.
        """
        return cls(q, *_exact(q.shape), time_ns, role)

    @property
    def valid(self) -> Mask:
        """(rows, cols) nodes that may be trusted."""
        return np.equal(self.flags, 0)

    def copy(self) -> Warp:
        """The same warp with a q of its own: a shown one's may be a view of the presentation log.

        Returns
        -------
        Warp
            The copy.
        """
        return replace(self, q=self.q.copy())

    def less(self, zero: Float | None) -> Warp:
        """The same warp with `zero`, (rows, cols, 2) LCD px, subtracted; None subtracts nothing.

        Parameters
        ----------
        zero : (rows, cols, 2) array, optional
            LCD px.

        Returns
        -------
        Warp
            The difference, with the sigma and flags of this one.
        """
        return self if zero is None else replace(self, q=self.q - zero)

    def with_left(self, shown_q: Float | Single, zero: Float | None, carrier: Mask | None) -> Warp:
        """The same warp with what was left to null when it was measured.

        Parameters
        ----------
        shown_q : (rows, cols, 2) array
            LCD px, what was shown meanwhile; rounded to single precision, as recordings keep it.
        zero : (rows, cols, 2) array, optional
            LCD px, what was subtracted from this warp; None for nothing.
        carrier : (rows, cols) bool, optional
            Nodes that were read by the carrier; None: all.

        Returns
        -------
        Warp
            The warp.
        """
        away = self.q - shown_q.astype(np.float32)
        left = (away if zero is None else away + zero).astype(np.float32)
        if carrier is not None:
            left[~carrier] = np.nan
        return replace(self, left=left)

    def __repr__(self) -> str:
        rows, cols = self.flags.shape
        share = 100 * float(np.mean(self.valid))
        return f"Warp({self.role}, {cols} x {rows} nodes, {share:.1f} % valid, {1e-9 * self.time_ns:.4f} s)"
