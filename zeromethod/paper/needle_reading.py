"""Section 3.1 of the paper, reproduced: three ways through its equations, and this system's own reading.

The paper's px is a length on the mirror; the bench of the own reading makes it 0.1 mm, as section 5 does.
"""

# ruff: noqa: E741 (the paper's l)

from __future__ import annotations

from dataclasses import asdict, astuple, dataclass
from typing import Any

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.optics import Dented, Flat, Optics
from zeromethod.paper.needle import (
    PAPER_DEPTH_ERROR_PX,
    PAPER_THETA_ERROR_RAD,
    SPACING_PX,
    Column,
    Errors,
    Needle,
    column,
    errors_of,
)
from zeromethod.rig.model import CameraSpec, DisplaySpec, KnownRest, Prism, Rig, SurfaceSpec, TargetSpec
from zeromethod.sensing.window import triangle
from zeromethod.surface import SurfaceReader
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

MM_PER_PX = 0.1
"""Section 5: 1 pixel is about 0.1 mm."""
FINE_PIXEL_MM = 0.01
"""Camera pixel of the own reading: its window must be small against the needle, whose tip is a kink."""
PERIOD_PX = 8
"""Carrier, camera px: the smallest that a rig file allows."""
_RIM_MM = 20.0
"""Rubber that goes on, at rest, beyond R0: there depth is known to be 0."""
_RAYS_PER_PIXEL = 32
_SIGMA_PX = 1e-3
_DISTANCE_MM = 200.0


@dataclass(frozen=True)
class NeedleReading:
    """The own reading of the needle along the mirror; all (n,), in the paper's px and rad.

    errors: "away" means farther than one averaging window from the tip (and from R0, where the tent ends
    in a second kink). window_px: half width of the averaging window on the mirror, the paper's px.
    """

    pixel_mm: float
    window_px: float
    l: Float
    theta: Float
    depth: Float
    errors: Errors


@dataclass(frozen=True)
class NeedleResult:
    """Everything section 3.1 shows.

    printed: equation 17 on the paper's own gamma = 0 model. lagged: the same, equation 19 with its lag of one
    interval. exact_17: equation 17 on exact geometry. exact_12: equation 12 inverted exactly, on exact
    geometry. zero_method: this system's reading; coarse: the same with camera pixels of the paper's size.
    """

    needle: Needle
    spacing_px: float
    printed: Column
    lagged: Column
    exact_17: Column
    exact_12: Column
    zero_method: NeedleReading
    coarse: NeedleReading

    def figures(self) -> dict[str, Any]:
        """JSON-ready figures; the largest errors per series, and how many times below the paper's bounds."""
        columns = {
            "equation_17_gamma_0": self.printed,
            "equation_17_gamma_0_lagged_sum": self.lagged,
            "equation_17_exact_geometry": self.exact_17,
            "equation_12_exact_geometry": self.exact_12,
        }
        readings = {"zero_method": self.zero_method, "zero_method_coarse": self.coarse}
        return {
            "needle": asdict(self.needle),
            "spacing_px": self.spacing_px,
            "paper": {
                "theta_max_error_rad": PAPER_THETA_ERROR_RAD,
                "depth_max_error_px": PAPER_DEPTH_ERROR_PX,
                "depth_error_percent": 1.0,
            },
            **{key: self._column(value) for key, value in columns.items()},
            **{key: self._reading(value) for key, value in readings.items()},
        }

    def _errors(self, errors: Errors) -> dict[str, float]:
        return {
            "theta_max_error_rad": errors.theta_rad,
            "depth_max_error_px": errors.depth_px,
            "depth_error_percent": 100 * errors.depth_px / self.needle.peak_px,
            "theta_away_error_rad": errors.theta_away_rad,
            "depth_away_error_px": errors.depth_away_px,
        }

    def _column(self, part: Column) -> dict[str, Any]:
        series = {"rises": part.rises, "drops": part.drops, "average": part.average}
        worst = Errors(*np.max([astuple(errors) for errors in series.values()], axis=0).tolist())
        return self._errors(worst) | {name: self._errors(errors) for name, errors in series.items()}

    def _reading(self, part: NeedleReading) -> dict[str, float]:
        return {
            **self._errors(part.errors),
            "camera_pixel_mm": part.pixel_mm,
            "window_px": part.window_px,
            "theta_times_below_paper": PAPER_THETA_ERROR_RAD / part.errors.theta_away_rad,
            "depth_times_below_paper": PAPER_DEPTH_ERROR_PX / part.errors.depth_away_px,
        }


class _Tent:
    """The needle as a dent of a mirror that goes on, at rest, beyond R0; mm."""

    def __init__(self, needle: Needle) -> None:
        self._needle = needle
        self._length_mm = needle.length_px * MM_PER_PX

    def _inside(self, x: Float) -> Mask:
        return np.asarray((x > 0.0) & (x < self._length_mm))

    def depth(self, x: Float, y: Float) -> Float:  # noqa: ARG002 (the needle is a ridge along y)
        return np.where(self._inside(x), MM_PER_PX * self._needle.depth(x / MM_PER_PX), 0.0)

    def slope(self, x: Float, y: Float) -> tuple[Float, Float]:
        return np.where(self._inside(x), np.tan(self._needle.theta(x / MM_PER_PX)), 0.0), np.zeros_like(y)


def reproduce_needle() -> NeedleResult:
    """Section 3.1, all columns, with points 2 px apart along the mirror (the paper does not say).

    printed comes to 0.00034 rad and 0.28 px in every series: equation 17 is short by (8/3) theta^3, which
    sums up to the tip and back. The paper says "under" 0.0008 rad and 0.4 px. Depth stays below 0.4 px at
    whole spacings up to 6 px (lagged sum: 4 px), beyond which the interval that holds the tip decides.
    Points within some px of P0 read theta worst, for an error of depth weighs d / l^2 there: at 1 px the
    very last point of the drops goes to 0.00094 rad, with the lagged sum to some mrad.
    """
    tent = Needle()
    return NeedleResult(
        needle=tent,
        spacing_px=SPACING_PX,
        printed=column(tent, exact=False, invert="equation 17"),
        lagged=column(tent, exact=False, invert="equation 17", step="printed"),
        exact_17=column(tent, exact=True, invert="equation 17"),
        exact_12=column(tent, exact=True, invert="equation 12", rim="closed"),
        zero_method=read_needle(tent, FINE_PIXEL_MM),
        coarse=read_needle(tent, MM_PER_PX),
    )


def read_needle(needle: Needle, pixel_mm: float) -> NeedleReading:
    """Read the needle off its exact warp, averaged as the sensor at the null averages it.

    The bench has the paper's geometry: faces at alpha0 and beta0 to a mirror from P0 over L0 and, at
    rest, 20 mm beyond; an orthographic camera normal to the camera face; no layers; an LCD as large as
    needed. Each camera pixel takes the mean of the exact rays over its area, each node the triangle window
    of +-(period - 1) px; then `SurfaceReader` reads slope and depth, with the rim beyond R0 known at rest.

    At a kink the window mixes slopes that the LCD position depends on nonlinearly: across the tip the depth
    goes wrong by about 1.2 slope^2 window, 0.03 px at 0.1 mm per camera pixel. That, not the rule
    of integration, limits the reading of a tent; it falls in proportion to the camera's pixel.
    """
    rig = _rig(needle, pixel_mm)
    optics = Optics(rig)
    grid = NodeGrid((rig.camera.rows, rig.camera.columns), PERIOD_PX)
    reader = SurfaceReader(rig, optics, grid)
    surface = reader.read(_measured(optics, grid, Dented(Flat(), _Tent(needle))))
    window_px = PERIOD_PX * pixel_mm / np.cos(needle.beta0) / MM_PER_PX
    row = grid.shape[0] // 2
    l = surface.x_mm[row] / MM_PER_PX
    # a flank that falls towards the camera appears stretched
    window_px /= 1.0 - needle.peak_px / needle.tip_px * np.tan(needle.beta0)
    # nodes whose window takes in the rim, with its own kink, are left out
    on_needle = surface.valid[row] & (l > 0.0) & (l < needle.length_px - window_px)
    l = l[on_needle]
    theta = np.arctan(surface.slope[row, on_needle, 0])
    depth = surface.depth_mm[row, on_needle] / MM_PER_PX
    errors = errors_of(needle, l, theta, depth, float(window_px))
    return NeedleReading(pixel_mm, float(window_px), l, theta, depth, errors)


def _rig(needle: Needle, pixel_mm: float) -> Rig:
    length_mm = needle.length_px * MM_PER_PX
    whole_mm = length_mm + _RIM_MM
    pattern_mm = whole_mm * np.sin(needle.beta0) / np.sin(needle.alpha0 + needle.beta0)
    captured_mm = whole_mm * np.sin(needle.alpha0) / np.sin(needle.alpha0 + needle.beta0)
    columns = int(captured_mm / pixel_mm) - 1
    rows = max(64, 4 * PERIOD_PX)
    to_camera = np.array([np.sin(needle.beta0), 0.0, -np.cos(needle.beta0)])
    middle = np.array([whole_mm / 2, 0.0, 0.0])
    window_mm = 2 * PERIOD_PX * pixel_mm / np.cos(needle.beta0)
    wide_mm = 4 * rows * pixel_mm
    return Rig(
        schema_version=2,
        name="needle",
        prism=Prism(
            pattern_angle_deg=float(np.degrees(needle.alpha0)),
            camera_angle_deg=float(np.degrees(needle.beta0)),
            mirror_length_mm=whole_mm,
            width_mm=wide_mm,
            index=1.41,
        ),
        display=DisplaySpec(
            columns=16000,
            rows=16000,
            pitch_mm=3.0 * pattern_mm / 16000,
            centre_mm=(pattern_mm / 2, 0.0),
            refresh_hz=60.0,
        ),
        camera=CameraSpec(
            columns=columns,
            rows=rows,
            projection="orthographic",
            pixel_mm=pixel_mm,
            centre_px=((columns - 1) / 2, (rows - 1) / 2),
            position_mm=tuple((middle + _DISTANCE_MM * to_camera).tolist()),
            look_at_mm=tuple(middle.tolist()),
            rate_hz=60.0,
            exposure_s=0.008,
        ),
        target=TargetSpec(period_px=PERIOD_PX),
        surface=SurfaceSpec(
            known_rest=(KnownRest(x_mm=(length_mm + window_mm, whole_mm), y_mm=(-wide_mm, wide_mm)),)
        ),
    )


def _measured(optics: Optics, grid: NodeGrid, mirror: Dented) -> Warp:
    """Warp of `mirror` at the nodes, averaged over pixels and window along u; along v it is linear."""
    rows, columns = grid.image_shape
    share = (np.arange(_RAYS_PER_PIXEL) + 0.5) / _RAYS_PER_PIXEL - 0.5
    u = np.arange(columns)[:, None] + share
    along_u = optics.trace(u, np.full_like(u, (rows - 1) / 2), mirror).q.mean(axis=1)
    window = triangle(grid.period_px)
    averaged = np.stack([np.convolve(along_u[:, axis], window, "valid") for axis in (0, 1)], axis=-1)
    first = grid.u_px[grid.inner[1]].astype(int) - (grid.period_px - 1)
    rest = optics.rest_map(*grid.mesh())
    q = np.full_like(rest, np.nan)
    # the needle is a ridge along y: rows differ by the same constant as at rest
    middle = optics.rest_map(*np.broadcast_arrays(grid.u_px, np.array((rows - 1) / 2)))
    q[:, grid.inner[1]] = (rest - middle)[:, grid.inner[1]] + averaged[first]
    flags = np.where(np.isfinite(q).all(axis=-1), 0, np.uint16(Flag.OUTSIDE)).astype(np.uint16)
    return Warp(q, np.full(q.shape, _SIGMA_PX), flags, 0)
