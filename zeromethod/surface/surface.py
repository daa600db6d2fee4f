"""The reading of one warp: slope and depth of the mirror per node, with their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.errors import check_type
from zeromethod.surface.curl import Curl
from zeromethod.surface.outside import Outside
from zeromethod.warp.continuation import continued


@dataclass(frozen=True, slots=True, repr=False)
class Anchor:
    """Nodes whose depth is taken as known.

    Attributes
    ----------
    mode : {"known", "loads", "quiet", "none"}
        The rig's rectangles at rest; the loads on the rubber that explain the slopes; in recordings of 0.2
        the quietest part of the border; or nothing was read.
    mask : (rows, cols) bool
        Nodes used.
    sigma_mm : float
        Standard deviation of depth, rms over the valid nodes, due to the unknown depth of the mask itself;
        by how far nodes of "known" are from rest.
    far_field_mm : float
        Mean depth (over `SurfaceReader.scale`) of the mask's nodes; 0 where they count as at rest.
    learned_ns : int
        Time of the picture from which it was learned which loads press; 0 where none was.
    outside : Outside, optional
        What presses outside the view, where that is 5 standard deviations and a quarter of all that presses.
    """

    mode: Literal["known", "loads", "quiet", "none"]
    mask: Mask
    sigma_mm: float
    far_field_mm: float = 0.0
    learned_ns: int = 0
    outside: Outside | None = None

    def __repr__(self) -> str:
        return f"<Anchor {self.mode}: {np.count_nonzero(self.mask)} nodes, sigma {self.sigma_mm:.3g} mm>"


@dataclass(frozen=True, slots=True, repr=False)
class Surface:
    """Slope and depth of the mirror on the full `NodeGrid`; NaN where not read (padding included).

    Attributes
    ----------
    depth_mm : (rows, cols)
        Positive into the rubber, from the rest surface along z at the node's own mirror point; bulges are
        negative.
    slope : (rows, cols, 2)
        (dd/dx, dd/dy) of depth, rad.
    x_mm, y_mm : (rows, cols)
        The mirror point. Finite everywhere, for plots: continued smoothly where the pixel's ray misses the
        mirror, given as NaN there.
    sigma_depth_mm : (rows, cols)
        Standard deviation of depth: noise of this one warp, the anchor's, what the rig's geometry leaves open
        (`GeometrySpec`), and before the null what the sensing window hides (`Warp.left`). It is against the
        mirror as the lens's pupil averages it, and correlated between nodes: `SurfaceReader.covariance`.
    sigma_slope : (rows, cols, 2)
        Standard deviation of slope, rad, at a fixed mirror point (within 1 mm of the LCD, by P0, depth's own
        noise moves the point and takes up to 14 % off). Not in it: where the mirror bends across the view's
        border, slopes in the last three rows of nodes err by up to as much as the bend from node to node.
    valid : (rows, cols) bool
        Nodes with a depth.
    contact : (rows, cols) bool
        Light lost: total reflection fails or something touches.
    anchor : Anchor
        Where depth was taken as known.
    time_ns : int
        The warp's.
    iterations : int
        Ray-surface intersections until depth settled.
    cut_off : Surface, optional
        Nodes that closed gaps, folds above all, separate from the valid nodes, tied to them by the slopes
        on either side (`zeromethod.surface.bridge`). Its valid nodes are none of these; their sigma includes
        the gap's.
    inside : Surface, optional
        Nodes inside contacts and in the unread rims around them, none of them measured: their depth is
        carried in from around by how rubber yields (`zeromethod.contact.inside`).
    curl : Curl, optional
        What the slopes contain that no mirror can make: motion of the bench under a press.
    on_mirror : (rows, cols) bool, optional
        Nodes whose ray meets the mirror; by default those with finite x_mm and y_mm.
    sigma_x_mm, sigma_y_mm : (rows, cols), optional
        Standard deviation of the mirror point by what the geometry leaves open, the same in every frame; 0
        where the geometry is exact.
    fold_per_mm : float
        Curvature of the mirror at which its image folds, 1/mm, median over the view: what a hole of unread
        nodes may hide bends at least as much. 0 where that is not known.
    seam : (rows, cols) bool, optional
        Of a saw: nodes whose window touches a seam between teeth. Those that are valid were not measured:
        their slope is carried across from both sides.
    slope_by_constant : (rows, cols, 2), optional
        Change of slope, 1/mm, by an error of depth's constant: all slopes share `anchor.sigma_mm` times it,
        which `sigma_slope` does not have.

    Notes
    -----
    World frame of `zeromethod.optics`; depth d = h_rest(x, y) - z.
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
    cut_off: Surface | None = None
    inside: Surface | None = None
    curl: Curl | None = None
    on_mirror: Mask = field(default_factory=lambda: np.zeros((0, 0), bool))
    sigma_x_mm: Float = field(default_factory=lambda: np.zeros((0, 0)))
    sigma_y_mm: Float = field(default_factory=lambda: np.zeros((0, 0)))
    fold_per_mm: float = 0.0
    seam: Mask | None = None
    slope_by_constant: Float | None = None

    def __post_init__(self) -> None:
        """Continue the mirror points where no ray meets the mirror."""
        if not self.sigma_x_mm.size:
            object.__setattr__(self, "sigma_x_mm", np.zeros(self.depth_mm.shape))
            object.__setattr__(self, "sigma_y_mm", np.zeros(self.depth_mm.shape))
        if not self.on_mirror.size:
            points = np.stack([self.x_mm, self.y_mm], axis=-1)
            object.__setattr__(self, "on_mirror", np.isfinite(points).all(axis=-1))
            points = continued_points(points)
            object.__setattr__(self, "x_mm", points[..., 0].copy())
            object.__setattr__(self, "y_mm", points[..., 1].copy())

    @property
    def points_mm(self) -> Float:
        """(rows, cols, 2) mirror points (x, y), NaN where the pixel's ray misses the mirror."""
        points = np.stack([self.x_mm, self.y_mm], axis=-1)
        return np.where(self.on_mirror[..., None], points, np.nan)

    def __repr__(self) -> str:
        deepest = self.depth_mm[self.valid]
        peak_mm = deepest[np.argmax(np.abs(deepest))] if deepest.size else np.nan
        return (
            f"<Surface {100 * np.mean(self.valid):.1f} % of {self.valid.size} nodes valid, "
            f"peak {peak_mm:.6g} mm, at {1e-9 * self.time_ns:.6f} s>"
        )


def continued_points(points: Float) -> Float:
    """Points (rows, cols, 2) with NaN replaced by a smooth continuation of the others, if there are any."""
    known: Mask = np.asarray(np.isfinite(points).all(axis=-1))
    if known.all() or not known.any():
        return points
    x, y = np.meshgrid(*(np.arange(n, dtype=np.float64) for n in known.shape[::-1]))
    return continued(points, x, y)


def check_surface(name: str, value: object) -> None:
    """Raise InputError for an argument that is no surface. name: of the function."""
    words = "a Surface, as Step.surface and Recording.surface give it; a step that was not read has None"
    check_type(f"{name}: surface", value, Surface, words)
