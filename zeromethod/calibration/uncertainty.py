"""What the data leave open: parameters that they do not separate, and what to measure next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from zeromethod.arrays import Float
from zeromethod.calibration.depth_modes import DepthError
from zeromethod.calibration.fitting import Fit, jacobian
from zeromethod.calibration.measurements import Direct, Intrinsics, Measurement, MirrorEdge
from zeromethod.calibration.parameters import PARAMETERS
from zeromethod.calibration.rays import UnboundedOptics, mirror_point

KEPT = 0.9
"""Share of its prior's sigma that a combination keeps when the data say next to nothing about it."""
_NAMED = 0.3
"""Part of a unit combination from which a parameter is named."""
_ROTATIONS = 100

PRESS_DEPTH_MM, PRESS_SIGMA_MM = 0.2, 0.6e-3
"""A press by a good height gauge: 0.2 mm known to +-1 µm."""
EDGE_PX = 2.0
_HAND_TOOLS = {
    "gap_mm": (0.02, "feeler gauge"),
    "display.along_mm": (0.25, "ruler, from the edge P0"),
    "prism.length_mm": (0.02, "calipers"),
    "prism.index": (0.001, "refractometer"),
    "prism.pattern_angle_deg": (0.05, "angle gauge"),
    "prism.captured_less_pattern_deg": (0.05, "angle gauge"),
}


@dataclass(frozen=True)
class Blend:
    """A combination of parameters of which the data say next to nothing.

    kept: its posterior sigma over its prior's. parts: (parameter, share) of the unit combination in units of
    priors, largest first, those of note only. depth_percent: what one posterior sigma of it does to depth,
    rms over the regions.
    """

    kept: float
    parts: tuple[tuple[str, float], ...]
    depth_percent: float

    @property
    def words(self) -> str:
        """In words: which parameters move together."""
        named = [PARAMETERS[name].words for name, _ in self.parts]
        if len(named) == 1:
            return f"{named[0]} is not seen by the data"
        signs = ["with" if share * self.parts[0][1] > 0 else "against" for _, share in self.parts[1:]]
        rest = ", ".join(f"{sign} {name}" for sign, name in zip(signs, named[1:], strict=True))
        return f"{named[0]} moves together {rest} unseen"


def open_combinations(fitted: Fit, error: DepthError) -> list[Blend]:
    """Combinations that keep more than `KEPT` of their prior, those that matter most for depth first.

    Eigenvectors of the posterior in units of the priors. Where several keep all of their prior they are open
    up to a rotation among themselves, which is chosen so that each names few parameters (varimax: H. F.
    Kaiser, Psychometrika 23 (1958) 187, doi:10.1007/BF02289233).
    """
    values, vectors = np.linalg.eigh(fitted.covariance)
    open_vectors = _few_words(vectors[:, values > KEPT**2])
    blends = []
    for vector in open_vectors.T:
        kept = float(np.sqrt(vector @ fitted.covariance @ vector))
        order = [i for i in np.argsort(-np.abs(vector)) if abs(vector[i]) > _NAMED]
        parts = tuple((fitted.priors.names[i], float(vector[i])) for i in order)
        depth = 100.0 * kept * float(np.sqrt(np.mean((error.sensitivity @ vector) ** 2)))
        blends.append(Blend(kept, parts, depth))
    return sorted(blends, key=lambda blend: -blend.depth_percent)


def _few_words(vectors: Float) -> Float:
    """Rotate orthonormal columns (n, m) among themselves so that each has few large entries."""
    rotation = np.eye(vectors.shape[1])
    before = 0.0
    for _ in range(_ROTATIONS):
        rotated = vectors @ rotation
        shape = rotated**3 - rotated * (rotated**2).mean(axis=0)
        left, spread, right = np.linalg.svd(vectors.T @ shape)
        rotation = left @ right
        if spread.sum() < before * (1.0 + 1e-9):
            break
        before = float(spread.sum())
    return vectors @ rotation


@dataclass(frozen=True)
class Gain:
    """What one more piece of data would bring.

    what: in words. percent: depth's sigma, rms over the regions, with it. before_percent: without. acts: how
    many things are done for it.
    """

    what: str
    percent: float
    before_percent: float
    acts: int = 1


def gains(fitted: Fit, error: DepthError) -> list[Gain]:
    """Every piece of data not yet given, by what it is expected to leave of depth's uncertainty, best first.

    Predicted to first order: the posterior with the data's derivatives added. Presses may be given any
    number of times, and are offered in the middle row of regions and as all three of it together.
    """
    given = {term.measurement.name for term in fitted.terms}
    by_hand: list[tuple[str, Measurement]] = [
        *((f"{one.name} by {tool}", one) for one, tool in _by_hand(fitted)),
        *((f"{one.name} in the image, to {one.sigma_px:g} px", one) for one in _edges(fitted)),
    ]
    if fitted.rig.camera.projection == "perspective":
        by_hand.append(("camera intrinsics by a board", _board(fitted)))
    offers = [(what, _rows(fitted, one)) for what, one in by_hand if one.name not in given]
    press = error.sensitivity * (PRESS_DEPTH_MM / PRESS_SIGMA_MM)
    middle = np.arange(1, len(error.names), 3)
    for index in middle:
        place = f"x = {error.x_mm[index]:z.0f} mm, y = {error.y_mm[index]:z.0f} mm"
        offers.append(
            (f"a press of {PRESS_DEPTH_MM:g} mm, known to 1 µm, at {place}", press[index : index + 1])
        )
    places = ", ".join(f"{error.x_mm[i]:z.0f}" for i in middle)
    offers.append((f"presses of {PRESS_DEPTH_MM:g} mm, known to 1 µm, at x = {places} mm", press[middle]))
    before = _rms(error.percent)
    found = [
        Gain(what, _rms(error.percent_with(_with(fitted.covariance, rows))), before) for what, rows in offers
    ]
    found[-1] = replace(found[-1], acts=len(middle))
    return sorted(found, key=lambda gain: gain.percent)


def expected(fitted: Fit, error: DepthError, measurement: Measurement) -> float:
    """Depth's sigma, percent rms over the regions, that one more measurement is expected to leave."""
    return _rms(error.percent_with(_with(fitted.covariance, _rows(fitted, measurement))))


def _rows(fitted: Fit, measurement: Measurement) -> Float:
    rows = jacobian(fitted.priors, fitted.z, measurement.prepared(fitted.rig))
    return rows[np.isfinite(rows).all(axis=-1)]


def _with(covariance: Float, rows: Float) -> Float:
    """Posterior with rows (n, parameters) of sigma 1 more (Sherman, Morrison, Woodbury)."""
    carried = covariance @ rows.T
    return covariance - carried @ np.linalg.solve(np.eye(len(rows)) + rows @ carried, carried.T)


def _rms(values: Float) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _by_hand(fitted: Fit) -> list[tuple[Direct, str]]:
    values = fitted.values
    return [
        (Direct(name, values[name], sigma), tool)
        for name, (sigma, tool) in _HAND_TOOLS.items()
        if name in values
    ]


def _board(fitted: Fit) -> Intrinsics:
    """What a ChArUco board typically gives: the focal lengths to 0.1 %."""
    focal = fitted.rig.camera.focal_px
    assert focal is not None
    return Intrinsics(("fx", "fy"), np.array(focal), np.diag((1e-3 * np.array(focal)) ** 2))


def _edges(fitted: Fit) -> list[MirrorEdge]:
    """Edges of the mirror that the fitted rig sees, one point each, in the middle of the view's height."""
    rig = fitted.rig
    optics = UnboundedOptics(rig)
    u = np.arange(rig.camera.columns, dtype=np.float64)
    v = np.full_like(u, (rig.camera.rows - 1) / 2)
    x = mirror_point(optics, u, v)[:, 0]
    found = []
    for edge, at_mm in (("P0", 0.0), ("R0", optics.length_mm)):
        crossing = np.flatnonzero(np.diff(np.sign(x - at_mm)) != 0)
        if len(crossing):
            pixel = np.array([[u[crossing[0]], v[0]]])
            found.append(MirrorEdge("P0" if edge == "P0" else "R0", pixel, EDGE_PX))
    return found


def strongest(gain: Sequence[Gain]) -> Gain | None:
    """Best piece of data that is a single act; None where nothing takes 5 % off."""
    single = [one for one in gain if one.acts == 1]
    if not single or single[0].percent > 0.95 * single[0].before_percent:
        return None
    return single[0]
