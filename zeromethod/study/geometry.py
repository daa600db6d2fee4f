"""Procedures that need no images, only the geometry of the bench.

"depth_error": uncertainty of depth owed to the geometry. "design": the deepest presses that a bench can null.
"""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float
from zeromethod.calibration import DepthError, Direct, Measurement, Priors, RestPositions, depth_error, fit
from zeromethod.calibration.parameters import PARAMETERS
from zeromethod.design.lever import gaussian_fold_mm, lcd_px_per_mrad, load_fold_mm
from zeromethod.design.press_limits import PressKind, press_limit
from zeromethod.design.sampled_view import SampledView, median_over
from zeromethod.design.tir import incidence_deg, margin_deg
from zeromethod.errors import InputError
from zeromethod.optics import Optics, check_geometry
from zeromethod.rig.model import Rig
from zeromethod.rig.refusal import shown
from zeromethod.study.task import Figures, Procedure, Task
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.warp import Warp

NOTHING = "nothing"

GROUPS: dict[str, str | tuple[str, ...]] = {
    "LCD's pose": "display.",
    "gap": "gap_mm",
    "camera's place": ("camera.x_mm", "camera.y_mm", "camera.z_mm"),
    "camera's direction": ("camera.heading_deg", "camera.elevation_deg", "camera.roll_deg"),
    "lens": ("camera.scale", "camera.aspect", "camera.centre", "camera.k", "camera.p1", "camera.p2"),
    "index": "prism.index",
    "prism's angles": ("prism.pattern_angle_deg", "prism.captured_less_pattern_deg"),
    "prism's length": "prism.length_mm",
    "teeth": ("teeth.", "tooth"),
}
"""What may be taken as exact, by the beginnings of its parameters' names."""

EVIDENCE = ("calipers", "rest map", "rest map, ruler", "rest map, press", "rest map, 3 presses")
_PRESSES = {"rest map, press": (4,), "rest map, 3 presses": (1, 4, 7)}
"""Indices of the known presses' regions: the middle one, or all three along the mirror's middle."""


def budget(task: Task) -> Figures:
    """Depth's standard deviation owed to geometry, to first order, at the rig as its file has it."""
    rig, settings = task.rig, task.settings
    check_geometry(rig)
    evidence = settings["evidence"]
    if evidence not in EVIDENCE:
        raise InputError(f"evidence: {shown(evidence)}: one of {', '.join(EVIDENCE)}")
    priors = Priors.of(rig, dict.fromkeys(_exact(rig, settings["exact"]), 0.0))
    grid = NodeGrid.of_rig(rig)
    measurements: list[Measurement] = []
    if evidence.startswith("rest map"):
        measurements.append(RestPositions.of(grid, _rest(rig, grid, float(settings["rest_sigma_px"]))))
    if evidence.endswith("ruler") and "display.along_mm" in priors.names:
        value = float(priors.mean[priors.names.index("display.along_mm")])
        measurements.append(Direct("display.along_mm", value, float(settings["ruler_sigma_mm"])))
    fitted = fit(priors, measurements)
    error = depth_error(fitted, grid)
    rows = error.sensitivity[list(_PRESSES.get(evidence, ()))]
    covariance = _with(error, rows * settings["press_depth_mm"] / settings["press_sigma_mm"])
    percent = error.percent_with(covariance)
    alone = np.sqrt(np.mean(error.sensitivity**2, axis=0) * np.diag(covariance))
    return {
        "depth_percent": float(np.sqrt(np.mean(percent**2))),
        "depth_worst_percent": float(percent.max()),
        "worst_region": error.names[int(percent.argmax())],
        "largest_parameter": PARAMETERS[priors.names[int(alone.argmax())]].words,
    }


def _exact(rig: Rig, name: str) -> list[str]:
    """Parameters of a group."""
    if name == NOTHING:
        return []
    if name not in GROUPS:
        raise InputError(f"exact: {shown(name)}: {NOTHING}, {', '.join(GROUPS)}")
    known = set(Priors.of(rig).names)
    return [
        parameter for parameter in PARAMETERS if parameter.startswith(GROUPS[name]) and parameter in known
    ]


def _rest(rig: Rig, grid: NodeGrid, sigma_px: float) -> Warp:
    """The rest map that a faultless measurement gives."""
    q = Optics(rig).rest_map(*grid.mesh())
    on_lcd = np.isfinite(q).all(axis=-1)
    return Warp(q, np.full(q.shape, sigma_px), np.where(on_lcd, 0, 1).astype(np.uint16), 0)


def _with(error: DepthError, rows: Float) -> Float:
    """Covariance with rows (n, parameters) of sigma 1 more."""
    if not len(rows):
        return error.covariance
    return np.asarray(np.linalg.inv(np.linalg.inv(error.covariance) + rows.T @ rows))


DEPTH_ERROR = Procedure(
    budget,
    {
        "depth_percent": "standard deviation of depth owed to geometry, rms over the view, percent",
        "depth_worst_percent": "the same where it is largest, percent",
        "worst_region": "where that is",
        "largest_parameter": "the number of the geometry that matters most",
    },
    {
        "evidence": "rest map",
        "exact": NOTHING,
        "rest_sigma_px": 0.02,
        "ruler_sigma_mm": 0.25,
        "press_depth_mm": 0.2,
        "press_sigma_mm": 1e-3,
    },
)


def limits(task: Task) -> Figures:
    """Limits of a press of `shape` and `size_mm` in the middle of the view; None: beyond any depth tried."""
    check_geometry(task.rig)
    view = SampledView(task.rig)
    kind = PressKind.parse(f"{task.settings['shape']}:{task.settings['size_mm']}")
    region = view.central
    limit = press_limit(view, kind, region.x_mm, region.y_mm)
    known = {"gaussian": gaussian_fold_mm, "load": load_fold_mm}.get(kind.shape.value)
    fold_mm = None if known is None else float(np.nanmedian(known(view, kind.size_mm)[region.mask]))
    return {
        "path_mm": float(np.median(view.trace.path_mm[region.mask])),
        "fold_mm": limit.fold_mm,
        "nulled_mm": limit.nulled_mm,
        "because": limit.because,
        "total_mm": limit.total_mm,
        "closed_form_mm": fold_mm,
        "incidence_deg": float(np.median(incidence_deg(view.trace)[region.mask])),
        "tir_least_margin_deg": float(np.nanmin(margin_deg(view))),
        "lcd_px_per_mrad": median_over(lcd_px_per_mrad(view), region.mask)[0],
        "sees_lcd_share": float(view.on_lcd.mean()),
    }


DESIGN = Procedure(
    limits,
    {
        "path_mm": "from the mirror to the LCD along the ray, optical lever included, mm",
        "fold_mm": "depth at which some node folds, mm",
        "nulled_mm": "deepest press that a picture nulls whole, mm",
        "because": "what ends it",
        "total_mm": "depth up to which reflection is total everywhere, mm",
        "closed_form_mm": "fold limit of a load or Gaussian by its curvature alone, mm",
        "incidence_deg": "angle of incidence at the mirror, middle of the view, deg",
        "tir_least_margin_deg": "least margin to the critical angle in the view, deg",
        "lcd_px_per_mrad": "lever along x, LCD px per mrad of slope",
        "sees_lcd_share": "share of the nodes that see the LCD",
    },
    {"shape": "load", "size_mm": 1.4},
)
