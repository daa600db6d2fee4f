"""Camera rays from the measured rest: the pixel of the rig file's ideal camera that has each node's true ray.

A camera's pixel-to-ray map is the part of a rig that is hardest to know (lens distortion, nominal focal
length), and a closed loop measures its effect at rest, node by node: the LCD position that the node looks at.
Where everything else is known, that position determines the ray: it is the ray of the pixel (u', v') at which
an ideal camera of the rig file would observe it. A reader on these pixels is zeroed at rest and has every
node's true ray, mirror point and lever, unlike one that only subtracts the warp at rest.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from zeromethod.arrays import Float
from zeromethod.optics import Optics
from zeromethod.warp.grid import NodeGrid

_STEP_PX = 0.5
"""Step by which derivatives of the rest map are found."""
_ITERATIONS, _SETTLED_PX = 8, 1e-9
"""Most Newton steps, and the miss, LCD px, that ends them."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RestGrid(NodeGrid):
    """Node grid whose rays are those of the pixels (u', v') of the rig file's ideal camera.

    pixels: (rows, cols, 2) (u', v') px. Only `mesh`, which gives the nodes' rays, differs from the grid it
    was made from.
    """

    pixels: Float = field(repr=False)

    @classmethod
    def of(cls, grid: NodeGrid, optics: Optics, q_rest: Float) -> RestGrid:
        """Nodes of `grid` at the pixels whose rays meet `q_rest` by the mirror at rest.

        q_rest: (rows, cols, 2) LCD px, measured at rest, NaN where unknown: such nodes keep their pixel.
        """
        pixels = rest_pixels(optics, np.stack(grid.mesh(), axis=-1), q_rest)
        return cls(image_shape=grid.image_shape, period_px=grid.period_px, pixels=pixels)

    def mesh(self) -> tuple[Float, Float]:
        """(u', v'), each (rows, cols): pixel of every node in the rig file's ideal camera."""
        return self.pixels[..., 0], self.pixels[..., 1]


def rest_pixels(optics: Optics, start: Float, q_rest: Float) -> Float:
    """Pixels (..., 2) of the rig file's camera that look at LCD positions `q_rest` by the mirror at rest.

    start: (..., 2) px, initial guess. Newton on the exact rays; a pixel stays at `start` where q_rest
    is NaN, no ray leads there, or the iteration does not settle.
    """
    pixels = start.copy()
    miss = np.full(start.shape[:-1], np.inf)
    for _ in range(_ITERATIONS):
        u, v = pixels[..., 0], pixels[..., 1]
        away = q_rest - optics.rest_map(u, v)
        by_u = (optics.rest_map(u + _STEP_PX, v) - optics.rest_map(u - _STEP_PX, v)) / (2 * _STEP_PX)
        by_v = (optics.rest_map(u, v + _STEP_PX) - optics.rest_map(u, v - _STEP_PX)) / (2 * _STEP_PX)
        area = by_u[..., 0] * by_v[..., 1] - by_u[..., 1] * by_v[..., 0]
        with np.errstate(invalid="ignore", divide="ignore"):
            du = (by_v[..., 1] * away[..., 0] - by_v[..., 0] * away[..., 1]) / area
            dv = (by_u[..., 0] * away[..., 1] - by_u[..., 1] * away[..., 0]) / area
        pixels = pixels + np.stack([du, dv], axis=-1)
        miss = np.hypot(du, dv)
        if not np.any(miss > _SETTLED_PX):
            break
    with np.errstate(invalid="ignore"):
        settled = miss < 1e-3
    return np.where(settled[..., None], pixels, start)
