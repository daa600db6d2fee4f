"""The node grid: a regular lattice in camera pixels on which all warps are defined."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Mask
from zeromethod.rig.model import Rig, check_rig

T = TypeVar("T", bound=np.generic)

PADDING = 4
"""Nodes outside the measurable ones on every side, so that the picture covers the whole view."""
INNER = slice(PADDING, -PADDING), slice(PADDING, -PADDING)
"""The measurable nodes, (rows, cols)."""


@dataclass(frozen=True)
class NodeGrid:
    """Nodes every half period of the carrier, in camera pixels; pixel centres at integer coordinates.

    A node is measurable when the window of +-(period - 1) px around it lies in the image. The grid
    contains the measurable nodes and `PADDING` more on every side, whose warp is continued.

    Parameters
    ----------
    image_shape : (int, int)
        Rows and columns of the camera image.
    period_px : int
        Even period of the target's carrier, camera px.
    """

    image_shape: tuple[int, int]
    period_px: int = 16

    @staticmethod
    def of_rig(rig: Rig) -> NodeGrid:
        """Nodes of a rig's camera and target.

        Parameters
        ----------
        rig : Rig
            The rig.

        Returns
        -------
        NodeGrid
            Its nodes.
        """
        check_rig("NodeGrid.of_rig", rig)
        return NodeGrid((rig.camera.rows, rig.camera.columns), rig.target.period_px)

    @property
    def spacing_px(self) -> int:
        """Camera px from node to node: half the (even) period, which block sums rely on."""
        return self.period_px // 2

    def _axis(self, length: int) -> Float:
        first = self.period_px
        count = (length - 1 - (self.period_px - 1) - first) // self.spacing_px + 1
        return first + self.spacing_px * np.arange(-PADDING, count + PADDING, dtype=np.float64)

    @cached_property
    def u_px(self) -> Float:
        """(cols,) camera column of each node column."""
        return self._axis(self.image_shape[1])

    @cached_property
    def v_px(self) -> Float:
        """(rows,) camera row of each node row."""
        return self._axis(self.image_shape[0])

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols) of the grid, padding included."""
        return len(self.v_px), len(self.u_px)

    @property
    def inner(self) -> tuple[slice, slice]:
        """Slices of the measurable nodes."""
        return INNER

    @property
    def measurable(self) -> Mask:
        """(rows, cols) whether a node is measurable."""
        return self.padded(np.ones([n - 2 * PADDING for n in self.shape], np.bool_), False)

    def padded(self, inner: NDArray[T], fill: float | bool) -> NDArray[T]:
        """Values of the measurable nodes, put into the whole lattice.

        Parameters
        ----------
        inner : array
            Values of the nodes inside the padding.
        fill : float or bool
            What stands in the padding.

        Returns
        -------
        (rows, cols, ...) array
            Values of all nodes.
        """
        full = np.full((*self.shape, *inner.shape[2:]), fill, dtype=inner.dtype)
        full[self.inner] = inner
        return full

    def mesh(self) -> tuple[Float, Float]:
        """(u, v), each (rows, cols): camera pixel of every node.

        Returns
        -------
        u, v : (rows, cols) array
            Camera column and row of each node.
        """
        u, v = np.meshgrid(self.u_px, self.v_px)
        return u, v
