"""The measured warp: the warp that was shown, composed with the residual that was seen in it.

Phase is known up to whole periods, and neighbours settle the order of neighbours. Nodes that cannot be
trusted (a fold, a contact, mixed pictures) settle nothing, so a region cut off by them may be read whole
periods wrong, with all of its nodes in perfect agreement. Such regions are AMBIGUOUS unless their order was
known in the frame before.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.exposure.pairing import Observation
from zeromethod.exposure.unmixing import at_full_contrast, unmix
from zeromethod.loop.across_seams import at_seams, bridged, settle_order
from zeromethod.loop.beside_dark import BesideDark
from zeromethod.loop.panel_blur import PanelBlur
from zeromethod.sensing.residual import Residual
from zeromethod.warp.components import blank, differences, largest_change, twice
from zeromethod.warp.compose import compose
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.jacobian import warp_flags
from zeromethod.warp.rest import Rest
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

SUDDEN_PERIODS = 0.25
"""Change between frames, in carrier periods, above which orders known before may have slipped."""

TRUSTED_SHARE = 0.5
"""Share of a cut-off region's nodes that must have been trusted before for it to be believed."""

_MIXED, _CODED = np.uint16(Flag.MIXED), np.uint16(Flag.CODED)
_AMBIGUOUS = np.uint16(Flag.AMBIGUOUS)
_SEAM = np.uint16(Flag.SEAM)


@dataclass(frozen=True, slots=True)
class Expected:
    """What earlier frames say of the next one.

    q: (rows, cols, 2) LCD px, where the nodes looked last. trusted: (rows, cols) nodes whose carrier order is
    known. residual_px: (rows, cols, 2) camera px, what the next residual is if nothing moved; NaN where not
    trusted. continued_px: the same of all nodes.
    """

    q: Float
    trusted: Mask
    residual_px: Float
    continued_px: Float


def _propagate(shown: Float, sigma_px: Float, spacing_px: float) -> Float:
    """sigma_i^2 = sum_j (dq_i/du_j sigma_j)^2, LCD px (rows, cols, 2); inf where sigma_px is not finite."""
    along, across = differences(shown, 1), differences(shown, 0)
    with np.errstate(invalid="ignore"):  # 0 times inf
        along *= twice(sigma_px[..., 0] / spacing_px)
        across *= twice(sigma_px[..., 1] / spacing_px)
    along *= along
    across *= across
    along += across
    sigma = np.sqrt(along, out=along)
    np.copyto(sigma, np.inf, where=np.isnan(sigma))
    return sigma


def _expected(shown: Float, known: Float, spacing_px: float) -> Float:
    """Solve to first order shown((u, v) + d) = known for d, camera px; NaN where shown has no area."""
    along, across, away = differences(shown, 1), differences(shown, 0), known - shown
    xu, yu, xv, yv = along[..., 0], along[..., 1], across[..., 0], across[..., 1]
    dx, dy = away[..., 0], away[..., 1]
    area = xu * yv - xv * yu
    nodes = spacing_px / np.where(area == 0.0, np.nan, area)
    return np.stack([(yv * dx - xv * dy) * nodes, (xu * dy - yu * dx) * nodes], axis=-1)


def expect(observation: Observation, known_q: Float, trusted: Mask, rest: Rest) -> Expected:
    """What the residual of an observation is expected to be; arguments as the members of `Expected`."""
    continued = _expected(observation.shown.q, known_q, rest.grid.spacing_px)
    return Expected(known_q, trusted, np.where(twice(trusted), continued, np.nan), continued)


def unmixed(residual: Residual, observation: Observation, grid: NodeGrid) -> Residual:
    """Residual against the mix that was shown, from the one that the sensor read.

    The mixture's bias is taken out of d, and what a moving target's known phase differs by from a node to
    where it looks; its loss of contrast is taken out of the modulation. All else is shared. Sigma stays: it
    goes by the carrier's amplitude as found, which mixing has lowered already.
    """
    mixture, target = observation.mixture, observation.target
    if mixture is None or mixture.bias_px is None:
        return residual
    d = unmix(residual.d, mixture.bias_px, grid, target)
    if target is None:
        return replace(residual, d=d)
    return replace(residual, d=d, modulation=at_full_contrast(residual.modulation, target))


def order_in_doubt(valid: Mask, trusted: Mask) -> Mask | None:
    """Valid nodes whose carrier order nothing settles, (rows, cols); None where there are none.

    valid: nodes measured well by themselves. trusted: those whose order was known in the frame before and
    cannot have slipped since. The largest connected region counts as known; any other only where at least
    half of it was trusted.
    """
    if not (valid & ~trusted).any():
        return None
    count, labels, stats, _ = cv2.connectedComponentsWithStats(valid.view(np.uint8), connectivity=4)
    if count < 3:
        return None
    known = np.bincount(labels.ravel(), weights=trusted.ravel(), minlength=count)
    doubted = known < TRUSTED_SHARE * stats[:, cv2.CC_STAT_AREA]
    doubted[0] = False
    doubted[1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))] = False
    if not doubted.any():
        return None
    mask: Mask = doubted[labels]
    return mask


def measure_warp(
    observation: Observation,
    residual: Residual,
    expected: Expected,
    rest: Rest,
    blur: PanelBlur | None = None,
    beside_dark: BesideDark | None = None,
    *,
    blind: Mask | None = None,
) -> Warp:
    """Measured warp q(u, v) = q_shown((u, v) + d) at mid-exposure, with sigma in LCD px and flags.

    Flags are the residual's, those of rest (NO_RAY), those of the warp itself, MIXED, BESIDE_DARK, and
    AMBIGUOUS for regions whose order is not known. q is NaN where the residual means nothing. Delay does not
    enter: the measurement is absolute. sigma is noise, and what the edge of a dark place does to nodes beside
    it; after a sudden press the residual bends within the window and is off by up to tenths of a px until the
    next picture (`sensing.window.curvature_bias_px2`).
    blur: of the panel, whose effect is taken out; None leaves it. beside_dark: memory of nodes beside dark
    places; None for none. blind: (rows, cols) nodes that may see the fringes of a burst, to be flagged CODED;
    None for none.

    Convention: residual d as observed(u, v) = T((u, v) + d), camera px.
    """
    grid = rest.grid
    shown = observation.shown
    seam = at_seams(expected.q, rest)
    settle_order(residual, shown.q, expected.residual_px, rest, seam if blind is None else seam | blind)
    q = compose(shown.q, residual.d, grid.spacing_px)
    if blur is not None:
        blur.add_hidden(shown.q, q)
    flags = residual.flags | rest.flags
    blank(q, flags != 0)
    size, spacing_px = rest.display_size, grid.spacing_px
    flags |= warp_flags(q, rest.q, grid.period_px, size, spacing_px=spacing_px, rest_areas=rest.areas)
    flags[seam] = _SEAM
    if observation.mixture is not None:
        flags[observation.mixture.mixed] |= _MIXED
    sigma_px = residual.sigma if beside_dark is None else beside_dark.flag(flags, residual.sigma)
    if blind is not None:
        flags[blind] |= _CODED
    valid, over_seams = flags == 0, bridged(q, flags, rest)
    if over_seams is not None:  # a seam that a slope opened is no contact
        flags[over_seams] = _SEAM
        valid |= over_seams
    if (rest.visible & (flags != 0)).any():
        changes = largest_change(residual.d, expected.residual_px)[flags == 0]
        sudden = bool((changes > SUDDEN_PERIODS * grid.period_px).any())  # NaN, no expectation, is not
        doubt = order_in_doubt(valid, np.zeros_like(expected.trusted) if sudden else expected.trusted)
        if doubt is not None:
            flags[doubt & (flags & _SEAM == 0)] |= _AMBIGUOUS
    sigma = _propagate(shown.q, sigma_px, grid.spacing_px)
    return Warp(q, sigma, flags, shown.time_ns)
