"""What a reading is: slope and depth of the mirror per node, with what is not known about them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from zeromethod.arrays import Float, Mask


@dataclass(frozen=True, slots=True)
class Anchor:
    """Where depth was taken as known.

    mode: "known" (the rig's rectangles at rest), "quiet" (the quietest part of the view's border) or "none"
    (nothing was read). mask: (rows, cols) nodes used. sigma_mm: standard deviation, rms over the valid nodes,
    that depth owes to what is not known about the mask's own depth; 0 for "known". tail_mm: depth (over
    `SurfaceReader.scale`) that the mask's nodes still have, told by the way slope and depth fall off; 0 where
    they count as at rest.
    """

    mode: Literal["known", "quiet", "none"]
    mask: Mask
    sigma_mm: float
    tail_mm: float = 0.0


@dataclass(frozen=True, slots=True)
class Surface:
    """Slope and depth of the mirror on the full `NodeGrid`; NaN where not read (padding included).

    depth_mm: (rows, cols), positive into the rubber, measured from the rest surface along z at the node's
        own mirror point; bulges are negative.
    slope: (rows, cols, 2), (dd/dx, dd/dy) of depth, rad.
    x_mm, y_mm: (rows, cols) the mirror point; NaN only where the pixel's ray misses the mirror.
    sigma_depth_mm: (rows, cols) standard deviation of depth: noise of this one warp and the anchor's.
        Between nodes it is correlated: `SurfaceReader.covariance`.
    sigma_slope: (rows, cols, 2) standard deviation of slope, rad, the mirror point held (within 1 mm of the
        LCD, by P0, depth's own noise moves the point and takes up to 14 % off).
    valid: (rows, cols) nodes with a depth. contact: (rows, cols) light lost: TIR fails or something touches.
    time_ns: the warp's. iterations: ray-surface intersections taken until depth settled.
    beyond: what closed gaps, folds above all, cut off from the valid nodes and slopes tie across them
        (`zeromethod.surface.bridge`); its own valid nodes are no others than these, and their sigma holds
        what the gap leaves open. None where there is no such thing.

    Convention: world frame of `zeromethod.optics`; depth d = h_rest(x, y) - z.
    """

    depth_mm: Float
    slope: Float
    x_mm: Float
    y_mm: Float
    sigma_depth_mm: Float
    sigma_slope: Float
    valid: Mask
    contact: Mask
    anchor: Anchor
    time_ns: int
    iterations: int
    beyond: Surface | None = None
