"""Where the mirror at rest is seen now, against the calibration: what that does to depth."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float
from zeromethod.bench_motion.fit import MotionFitter
from zeromethod.bench_motion.modes import BenchModes
from zeromethod.bench_motion.watch import LEAST_LCD_PX
from zeromethod.commissioning.daily_check.findings import Finding, Fitness, Subject
from zeromethod.loop.zero import LARGEST_LCD_PX
from zeromethod.optics import Dented, Optics
from zeromethod.rig.model import Rig
from zeromethod.simulation.press import Dent, Mirror, Shape
from zeromethod.surface import SurfaceReader, peak
from zeromethod.warp.rest import Rest
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

MOST_PERCENT = 1.0
"""Error of depth, after re-zeroing, from which a new calibration is asked for."""

_PROBE_TURN_MM = 0.05
_PROBE_DEPTH_MM = 0.1
_PROBE_WIDTH_SHARE = 0.1
_PROBE_SIGMA_PX = 0.02


def judge_rest(optics: Optics, rest: Rest, reader: SurfaceReader, seen: Warp) -> Finding:
    """Compare the rest as it is seen now with the rig's.

    optics, rest: the rig's. seen: mean measured warp of the untouched mirror.
    """
    known = seen.valid & rest.visible
    away_px = (seen.q - rest.q)[known]
    rms_px = float(np.sqrt(np.mean(np.sum(away_px**2, axis=-1))))
    false = peak(reader.read(seen))
    percent = rms_px * float(depth_percent_per_px(optics.rig).max())
    figures = {
        "rest_drift_lcd_px": rms_px,
        "rest_false_depth_um": 1e3 * false.depth_mm,
        "rest_false_depth_sigma_um": 1e3 * false.sigma_mm,
        "rezeroed_depth_error_percent": percent,
    }
    words = (
        f"{rms_px:.3f} LCD px rms from the calibration's; the untouched mirror reads up to "
        f"{1e3 * false.depth_mm:+z.2f} ± {1e3 * false.sigma_mm:.2f} µm"
    )
    if rms_px < LEAST_LCD_PX:
        return Finding(Subject.REST, Fitness.GOOD, words, figures)
    words += (
        f": the bench moved {_motion(optics, rest, seen)}; re-zeroed (z in `run`), up to {percent:.2g} % of "
    )
    words += "depth is left, if it is the camera that turned"
    far = np.abs(away_px).max() > LARGEST_LCD_PX or percent > MOST_PERCENT
    return Finding(Subject.REST, Fitness.RECALIBRATE if far else Fitness.DRIFTED, words, figures)


def _motion(optics: Optics, rest: Rest, seen: Warp) -> str:
    """By how much, and which group of motions."""
    modes = BenchModes.of(optics, rest.grid)
    fitter = MotionFitter(modes, rest.grid, rest.visible)
    terms = fitter.fit(seen, rest.q)
    return "in part of the view" if terms is None else modes.words(fitter.motion(terms))


def depth_percent_per_px(rig: Rig) -> Float:
    """(2,) by how much depth is wrong, re-zeroed, per LCD px that a turn of the camera moved the rest.

    Of a camera turned along the mirror, and across it: a press of the middle of the view is traced through
    such a rig and read by this one. (An LCD that slid is taken out by re-zeroing exactly.)
    """
    camera = rig.camera.model_copy(update={"rest_map": None})
    geometry = rig.model_copy(update={"camera": camera})
    optics = Optics(geometry)
    rest = Rest.of(geometry, optics)
    reader = SurfaceReader(geometry, optics, rest.grid)
    u, v = rest.grid.mesh()
    point = optics.trace(u, v, optics.rest).point[rest.visible]
    middle, extent = np.median(point, axis=0), np.ptp(point, axis=0)
    size_mm = _PROBE_WIDTH_SHARE * float(extent[:2].min())
    dent = Dent(Shape.GAUSSIAN, float(middle[0]), float(middle[1]), _PROBE_DEPTH_MM, size_mm)
    percents = []
    for axis in range(2):
        aim_mm = list(rig.camera.look_at_mm)
        aim_mm[axis] += _PROBE_TURN_MM
        turned = Optics(geometry.replace({"camera.look_at_mm": aim_mm}))
        untouched = turned.trace(u, v, turned.rest).q
        pressed = turned.trace(u, v, Dented(turned.rest, Mirror((dent,)))).q
        seen = rest.visible & np.isfinite(pressed).all(axis=-1) & np.isfinite(untouched).all(axis=-1)
        drift_px = float(np.sqrt(np.mean(np.sum((untouched - rest.q)[seen] ** 2, axis=-1))))
        q = np.where(seen[..., None], pressed - untouched + rest.q, rest.q)
        flags = np.where(seen, np.uint16(0), np.uint16(Flag.NO_RAY))
        read = peak(reader.read(Warp(q, np.full(q.shape, _PROBE_SIGMA_PX), flags, 0)))
        percents.append(100.0 * abs(read.depth_mm / _PROBE_DEPTH_MM - 1.0) / drift_px)
    return np.array(percents)
