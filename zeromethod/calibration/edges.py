"""The mirror's edges P0 and R0 in the camera's image: where fringes end because the mirror does.

A rig fitted to the rest map predicts each edge's image and how far off it may be. There, and only there,
every line of pixels across the edge is searched from the mirror outwards for the place at which the fringes'
amplitude falls to half. That place is the edge only where nothing else can be: fringes up to it that belong
to the rest map, darkness past it, a step and not a gradual loss (vignetting, the limit of total reflection),
a line of the predicted direction and bend (not an aperture's rim), and the LCD going on (not its end).
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Mask
from zeromethod.calibration.edge_curve import EdgeCurve
from zeromethod.calibration.fitting import Fit, jacobian
from zeromethod.calibration.measurements import MirrorEdge
from zeromethod.calibration.rays import UnboundedOptics, mirror_point
from zeromethod.calibration.steps import steps_down
from zeromethod.decoding.measuring import RestMeasurement
from zeromethod.optics import Optics
from zeromethod.optics.trace import Lost
from zeromethod.rig.model import Rig

Name = Literal["P0", "R0"]

EDGE_MM = 0.1
"""How well an edge of cast rubber is a line, and the one at which the faces' planes meet (sigma)."""

PIXEL_PX = 0.3
"""A step seen on a grid of pixels, sigma along a line that may lie along the grid: sqrt(1 / 12)."""

GATE_SIGMAS = 4.0
"""How far from where it is expected an edge is sought, in sigma of what is expected."""

LEAST_SHARE = 0.5
"""Share of the lines across an edge that must show it, on one curve."""

LEAST_LINES = 24
MOST_BEND_SHARE = 0.004
"""Bend beyond the predicted one, of the length over which an edge is seen: more is an aperture's rim."""

LCD_MARGIN_PX = 6.0
"""Distance from the LCD's end, LCD px, within which it may be that which ends the picture."""

INSIDE_MM = 1.5
"""Just inside the mirror: there the fitted rig must see the LCD."""

MOST_LOST = 0.25
"""Share of the lines on which the fitted rig may see something else end just inside an edge."""

_LINES, _PLACES = 17, 129
_REACH = 0.5
"""How far past the image, in its width, an edge's image is followed."""
_LEAST_SIGMA_PX = 2.0


class NoEdge(enum.StrEnum):
    """Reasons why an edge is not taken, as a person reads them."""

    NOT_IN_VIEW = "not in view"
    NO_END = "no sharp end of the fringes where it should be"
    RAGGED = "the fringes' end there is no clean line"
    BENT = "the fringes end there on a bent line: an aperture's rim"
    TOO_FAR = "the fringes' end there is too far from where it should be"
    OTHER_DIRECTION = "the fringes' end there runs in another direction"
    LCD_ENDS = "the LCD ends there, too"
    TIR_ENDS = "total reflection ends there, too"
    FACE_ENDS = "the pattern face ends there, too"


@dataclass(frozen=True, eq=False)
class EdgeSearch:
    """What became of the search for one edge.

    found: two points of it as a measurement, or why there are none. along: axis of the image on which it lies
    at one place. width_px: of the step there.
    """

    edge: Name
    found: MirrorEdge | NoEdge
    along: Literal["column", "row"] = "column"
    width_px: float = float("nan")

    @property
    def words(self) -> str:
        """Where it is, or why it is not taken."""
        if isinstance(self.found, NoEdge):
            return str(self.found)
        place = float(self.found.pixel[:, 1 if self.along == "row" else 0].mean())
        sigma_px = self.found.sigma_px / np.sqrt(2.0)
        return f"found at {self.along} {place:.1f} (sigma {sigma_px:.1f} px; {self.width_px:.1f} px wide)"


def find_edges(fitted: Fit, rest: RestMeasurement) -> tuple[EdgeSearch, EdgeSearch]:
    """Look for P0 and R0 where `fitted`, a fit to the rest map `rest`, expects them."""
    return _search(fitted, rest, "P0"), _search(fitted, rest, "R0")


class _NoEdgeError(Exception):
    """An edge is not taken; its argument is the `NoEdge`."""


def _search(fitted: Fit, rest: RestMeasurement, edge: Name) -> EdgeSearch:
    try:
        return _seen(fitted, rest, edge)
    except _NoEdgeError as error:
        return EdgeSearch(edge, *error.args)


def _seen(fitted: Fit, rest: RestMeasurement, edge: Name) -> EdgeSearch:
    """Find an edge; raises _NoEdgeError."""
    expected = _Expected.of(fitted, edge)
    valid, amplitude, lcd = rest.rest_map.valid, rest.amplitude, rest.rest_map.lcd_px
    if expected.turned:
        valid, amplitude, lcd = valid.T, amplitude.T, lcd.swapaxes(0, 1)
    rows = np.flatnonzero(expected.reachable(amplitude.shape[1]))
    if len(rows) < LEAST_LINES or not valid.any():
        raise _NoEdgeError(NoEdge.NOT_IN_VIEW)
    usual = float(np.median(amplitude[valid]))
    place, width = steps_down(
        amplitude[rows], valid[rows], expected.place[rows], expected.gate_px, expected.outwards, usual
    )
    seen = np.isfinite(place)
    least = max(LEAST_LINES, LEAST_SHARE * len(rows))
    if np.count_nonzero(seen) < least:
        raise _NoEdgeError(_nowhere(expected, amplitude.shape[1]))
    line, place = rows[seen], place[seen]
    curve = EdgeCurve.of(line.astype(np.float64), place - expected.place[line])
    if curve is None or curve.share * len(line) < least:
        raise _NoEdgeError(NoEdge.RAGGED)
    sigma = float(np.sqrt(curve.sigma_px**2 + PIXEL_PX**2 + (EDGE_MM * expected.px_per_mm) ** 2))
    _check_curve(curve, expected, sigma)
    _check_lcd(fitted.rig, lcd[line], place, expected.outwards)
    _check_model(fitted.rig, expected, line)
    quarters = curve.middle + curve.half * np.array([-0.5, 0.5])
    points = np.stack([np.interp(quarters, rows, expected.place[rows]) + curve.at(quarters), quarters], -1)
    # Two points with errors of their own that together know the line's place to `sigma`.
    pixel = points[:, ::-1] if expected.turned else points
    found = MirrorEdge(edge, pixel, float(np.sqrt(2.0) * sigma))
    return EdgeSearch(edge, found, "row" if expected.turned else "column", float(np.median(width[seen])))


def _nowhere(expected: _Expected, size: int) -> NoEdge:
    """Why no edge is there: past the image's border as likely as not, or something is strange."""
    middle = float(np.nanmean(expected.place))
    if not expected.margin_px <= middle <= size - 1 - expected.margin_px:
        return NoEdge.NOT_IN_VIEW
    return NoEdge.NO_END


def _check_curve(curve: EdgeCurve, expected: _Expected, sigma_px: float) -> None:
    """Refuse a curve that is bent or not where and how the edge should lie."""
    length = 2.0 * curve.half
    if abs(curve.bend_px) > max(PIXEL_PX + 4.0 * curve.sigma_px, MOST_BEND_SHARE * length):
        raise _NoEdgeError(NoEdge.BENT)
    away = abs(float(curve.at(np.array([curve.middle]))[0]))
    if away > GATE_SIGMAS * np.hypot(expected.sigma_px, sigma_px):
        raise _NoEdgeError(NoEdge.TOO_FAR)
    if abs(curve.tilt) > GATE_SIGMAS * np.hypot(expected.sigma_tilt, 2.0 * sigma_px / length):
        raise _NoEdgeError(NoEdge.OTHER_DIRECTION)


def _check_lcd(rig: Rig, lcd: Float, place: Float, outwards: int) -> None:
    """Refuse an end of the fringes at the LCD's end. lcd: (lines, n, 2) rest map; place: (lines,) px."""
    inner = [np.clip(np.rint(place - outwards * step).astype(int), 0, lcd.shape[1] - 1) for step in (5, 12)]
    near, far = (lcd[np.arange(len(lcd)), at] for at in inner)
    run = (outwards * (place - inner[0]) / np.maximum(outwards * (inner[0] - inner[1]), 1))[:, None]
    q = near + run * (near - far)
    size = np.array([rig.display.columns, rig.display.rows])
    known = q[np.isfinite(q).all(axis=-1)]
    if not len(known) or np.median(np.minimum(known + 0.5, size - 0.5 - known).min(axis=-1)) < LCD_MARGIN_PX:
        raise _NoEdgeError(NoEdge.LCD_ENDS)


def _check_model(rig: Rig, expected: _Expected, line: NDArray[np.int_]) -> None:
    """Refuse an edge next to which the fitted rig itself sees something else end."""
    inside = expected.place[line] - expected.outwards * INSIDE_MM * expected.px_per_mm
    u, v = (line.astype(np.float64), inside) if expected.turned else (inside, line.astype(np.float64))
    optics = Optics(rig)
    lost = optics.trace(u, v, optics.rest).lost
    for loss, reason in (
        (Lost.BELOW_TIR, NoEdge.TIR_ENDS),
        (Lost.MISSES_PATTERN_FACE, NoEdge.FACE_ENDS),
        (Lost.OFF_DISPLAY, NoEdge.LCD_ENDS),
    ):
        if np.mean(lost == loss) > MOST_LOST:
            raise _NoEdgeError(reason)


@dataclass(frozen=True, eq=False)
class _Expected:
    """An edge's image as a fitted rig predicts it.

    Lines run across the edge: rows of the image, columns where `turned`. place: (lines,) px along each, NaN
    where it is nowhere near. sigma_px: of the middle; sigma_tilt: px per px along the edge. outwards: +1
    where the mirror ends towards larger px.
    """

    place: Float
    turned: bool
    outwards: int
    sigma_px: float
    sigma_tilt: float
    px_per_mm: float

    @property
    def gate_px(self) -> float:
        """Half width of the search."""
        return GATE_SIGMAS * float(np.hypot(self.sigma_px, _LEAST_SIGMA_PX + EDGE_MM * self.px_per_mm))

    @property
    def margin_px(self) -> float:
        """Distance from the image's border within which an edge may well lie past it."""
        return _LEAST_SIGMA_PX + 2.0 * self.sigma_px

    def reachable(self, size: int) -> Mask:
        """Lines in whose image the edge may be."""
        with np.errstate(invalid="ignore"):
            return np.asarray(np.abs(self.place - 0.5 * (size - 1)) < 0.5 * size + self.gate_px)

    @classmethod
    def of(cls, fitted: Fit, edge: Name) -> _Expected:
        """Predict; raises _NoEdgeError where the edge is nowhere near the image."""
        rig = fitted.rig
        optics = UnboundedOptics(rig)
        at_mm = 0.0 if edge == "P0" else optics.length_mm
        columns, rows = rig.camera.columns, rig.camera.rows

        def x_of(u: Float, v: Float) -> Float:
            return mirror_point(optics, u, v)[..., 0]

        middle = np.array([0.5 * (columns - 1)]), np.array([0.5 * (rows - 1)])
        by_u = float((x_of(middle[0] + 1, middle[1]) - x_of(middle[0] - 1, middle[1]))[0])
        by_v = float((x_of(middle[0], middle[1] + 1) - x_of(middle[0], middle[1] - 1))[0])
        turned = abs(by_v) > abs(by_u)
        size, lines = (rows, columns) if turned else (columns, rows)
        place = _followed(x_of, at_mm, size, lines, turned)
        known = np.flatnonzero(np.isfinite(place))
        if len(known) < LEAST_LINES:
            raise _NoEdgeError(NoEdge.NOT_IN_VIEW)
        ends = known[[len(known) // 4, 3 * len(known) // 4]].astype(np.float64)
        points = np.stack([place[ends.astype(int)], ends], axis=-1)
        pixel = points[:, ::-1] if turned else points
        step = 0.5 * (x_of(*(pixel + _unit(turned)).T) - x_of(*(pixel - _unit(turned)).T))
        if not (np.isfinite(step).all() and np.all(step != 0.0)):
            raise _NoEdgeError(NoEdge.NOT_IN_VIEW)
        # MirrorEdge's numbers are distances at right angles to the edge; along a line they are longer
        slant = float(np.hypot(1.0, (points[1, 0] - points[0, 0]) / max(np.ptp(ends), 1.0)))
        rows_of = slant * jacobian(fitted.priors, fitted.z, MirrorEdge(edge, pixel, 1.0))
        mean, tilt = rows_of.mean(axis=0), (rows_of[1] - rows_of[0]) / max(float(np.ptp(ends)), 1.0)
        outwards = int(np.sign(step[0])) * (-1 if edge == "P0" else 1)
        return cls(
            place,
            turned,
            outwards,
            float(np.sqrt(mean @ fitted.covariance @ mean)),
            float(np.sqrt(tilt @ fitted.covariance @ tilt)),
            float(1.0 / np.abs(step).mean()),
        )


def _unit(turned: bool) -> Float:
    return np.array([0.0, 1.0] if turned else [1.0, 0.0])


def _followed(
    x_of: Callable[[Float, Float], Float], at_mm: float, size: int, lines: int, turned: bool
) -> Float:
    """(lines,) px along each line at which the mirror's x is `at_mm`; NaN where that is far off the image."""
    along = np.linspace(-_REACH * size, (1 + _REACH) * size, _PLACES)
    across = np.linspace(0, lines - 1, _LINES)
    s, line = np.meshgrid(along, across)
    x = x_of(line, s) if turned else x_of(s, line)
    found = np.full(_LINES, np.nan)
    for number, values in enumerate(x):
        known = np.isfinite(values)
        if np.count_nonzero(known) < 3:
            continue
        place, away = along[known], values[known] - at_mm
        change = np.flatnonzero(np.diff(np.sign(away)) != 0)
        if len(change) == 1:
            i = int(change[0])
            found[number] = place[i] - away[i] * (place[i + 1] - place[i]) / (away[i + 1] - away[i])
    known = np.isfinite(found)
    if np.count_nonzero(known) < 3:
        return np.full(lines, np.nan)
    first, last = across[known][0], across[known][-1]
    everywhere = np.arange(lines, dtype=np.float64)
    # smooth and short: a cubic follows what the lens and the faces do to a straight edge
    middle, half = 0.5 * (lines - 1), 0.5 * lines
    cubic = np.polyfit((across[known] - middle) / half, found[known], 3)
    place = np.polyval(cubic, (everywhere - middle) / half)
    return np.where((everywhere >= first) & (everywhere <= last), place, np.nan)
