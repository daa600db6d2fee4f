"""Which period of the carrier is seen, found absolutely by one picture that is drawn a little larger.

Phase is known up to whole periods, and neighbours settle the order of neighbours. Nothing settles that of the
whole view when a run begins with something pressed, after frames without a view, or after a jump of all of
it. Then the picture is kept, and one frame of it is compared with one of the same picture enlarged by s about
the view's middle: a node that sees the point a of the target (camera px from the middle) in the first sees
b = (1 + s) a in the second. Both are read up to whole periods P,

    b - (1 + s) a = s m P + (whole periods),

and what is left of the difference says by how many periods m the first was misread, of up to 1 / (2 s).
"""

from __future__ import annotations

import enum

import numpy as np

from zeromethod.arrays import Flags, Float, Ints, Mask
from zeromethod.exposure.pairing import Observation
from zeromethod.loop.measured_warp import Expected, expect
from zeromethod.sensing.residual import Residual
from zeromethod.warp.components import largest_change
from zeromethod.warp.compose import compose
from zeromethod.warp.continuation import continue_smoothly
from zeromethod.warp.rest import Rest
from zeromethod.warp.validity import Flag

ENLARGED = 1 / 32
"""s: half a camera px for each period of 16, some fifty times a node's noise."""

QUIET_PX, QUIET_SHARE = 0.25, 0.25
"""A node is where it was (or at rest) if its residual is this close to the expected one, camera px. If this
share of the nodes is, the order is not in doubt: one jump in a thousand would look so by chance."""

JUMP_PERIODS, JUMPED_SHARE, JUMPED_QUIET_SHARE = 1 / 8, 0.5, 0.08
"""A node jumped if it changed by this many periods between frames; the view jumped if this share of its nodes
did, and a press did it if more than the last share did not move."""

STILL_SHARE, SUDDEN_FRAMES = 0.75, 2
"""The mirror is still if this share of the nodes does not move; after a small motion of the whole view it
must be still again within this many frames. The view may then have jumped by whole periods and a little more,
of which phase shows only the little."""

BENT_SHARE = 0.65
"""Part of the nodes' motion that shift, turn and stretch of the whole picture do not explain, over all of it
(medians), above which a press caused it: 0.76 by a finger in a small view, 0.44 by a dent much wider than
it."""

SIDE_SHARE, BARE_CONTRAST = 0.9, 0.3
"""A side of the view looks past the drawn picture if this share of its outermost nodes see light but less
than this share of the view's mean contrast, as happens from a displacement of 1.7 periods on. Phase does not
show whole periods, so that such a displacement may look like a small bend."""

ALIKE_PX = 0.05
"""Pictures count as the same one up to this difference, LCD px, and this effect of their mixture, camera
px."""

GAP_S, LEAST_SHARE = 0.25, 0.5
"""The order is to be found again after this time without a measurement of at least this share of the
nodes."""

CLEAR, CLEAR_SHARE = 0.25, 0.8
"""A node shows its order if its result is this close to a whole number; this share of the nodes must show the
same one, as unwrapping has already made neighbours agree."""

STEADY_FRAMES = 3
"""Consecutive frames that must see a picture alone, after a first attempt has failed: while the delay is
unknown, the first of them may have seen the picture before."""

LONGEST_S = 1.0
"""Time after which an order that could not be found counts as lost."""

_LIGHT_LOST, _SOME = np.uint16(Flag.LIGHT_LOST), 8

_SAME_LCD_PX = 1e-3
"""Difference between warps that are the same; recordings round them."""


class Order(enum.StrEnum):
    """What is known of the carrier's order; the value says it to the operator."""

    KNOWN = ""
    DOUBTED = "finding out which period of the carrier is seen"
    UNKNOWN = (
        "which period of the carrier is seen cannot be found out: keep what is pressed still, or lift it"
    )


class OrderCheck:
    """Doubt in the carrier's order, and the pictures that end it.

    diagonal: the target's carriers run along u + v and u - v.
    """

    def __init__(self, rest: Rest, *, diagonal: bool) -> None:
        self._rest = rest
        u, v = rest.grid.mesh()
        self._from_middle = np.stack(
            [u - 0.5 * (u[0, 0] + u[-1, -1]), v - 0.5 * (v[0, 0] + v[-1, -1])], axis=-1
        )
        self._diagonal = diagonal
        self._visible = int(np.count_nonzero(rest.visible))
        sides = _outermost(rest.visible)
        self._side_sizes = np.array([len(side) for side in sides])
        self._side_starts = np.cumsum([0, *self._side_sizes[:-1]])
        self._sides = np.concatenate(sides)
        self._past, self._stirred = np.zeros(len(sides), np.bool_), True
        self._started = False
        self._last_ns = 0
        self._steady = 0
        self._failed = False
        self._still = False
        self._unsure = 0
        self._since_ns = 0
        self._kept: Float | None = None
        self._larger: Float | None = None
        self._seen: tuple[Float, Mask] | None = None

    @property
    def commanded(self) -> Float | None:
        """(rows, cols, 2) LCD px to be shown, whatever the controller says; None: what it says."""
        return self._larger if self._larger is not None else self._kept

    def order(self, time_ns: int) -> Order:
        """What is known of the order at a time."""
        if self._kept is None:
            return Order.KNOWN
        return Order.UNKNOWN if time_ns - self._since_ns > 1e9 * LONGEST_S else Order.DOUBTED

    def look(self, observation: Observation, residual: Residual, expected: Expected) -> Expected | None:
        """Take in a frame's residual; what it must be held against, where the order has just been found.

        expected: what was expected of the frame.
        """
        time_ns = observation.shown.time_ns
        if np.count_nonzero(residual.flags == 0) < LEAST_SHARE * self._visible:
            # the picture that is kept may be what hides them: the loop goes on by itself, in doubt again
            self._kept = self._larger = self._seen = None
            self._started = self._still = False
            self._unsure = 0
            return None
        interrupted = not self._started or time_ns - self._last_ns > 1e9 * GAP_S
        self._started, self._last_ns = True, time_ns
        jump_px = JUMP_PERIODS * self._rest.grid.period_px
        if self._kept is None:
            quiet, jumped = _changes(residual.d, expected.residual_px, residual.flags, QUIET_PX, jump_px)
            # a press bends the picture, however far it is seen; a bench that moves does not
            all_moved = quiet < JUMPED_QUIET_SHARE and (self._still or jumped > JUMPED_SHARE)
            moves = all_moved and self._as_one_piece(residual, expected)
            jumps = moves and jumped > JUMPED_SHARE
            slides = self._slides(residual, quiet)
            self._still = quiet > STILL_SHARE
            if not slides and (quiet > QUIET_SHARE or not (interrupted or jumps or moves)):
                return None
            at_rest = expect(observation, self._rest.q, self._rest.visible, self._rest).residual_px
            quiet = _changes(residual.d, at_rest, residual.flags, QUIET_PX, jump_px)[0]
            if not slides and quiet > QUIET_SHARE:
                return None
            # as this frame saw it, which shows what a picture to be kept must
            self._kept, self._since_ns, self._seen = observation.shown.q.copy(), time_ns, None
            self._steady = 0
            if moves and not (jumps or interrupted or slides):
                # so that no frame is lost where it is over in the next, which still sees the picture kept
                self._larger, self._unsure = self._enlarged(self._kept), 1
                return None
        if self._unsure > 0:
            quiet = _changes(residual.d, expected.residual_px, residual.flags, QUIET_PX, jump_px)[0]
            self._settle(observation, residual, quiet > STILL_SHARE)
            return None
        return self._compare(observation, residual, expected)

    def _slides(self, residual: Residual, quiet: float) -> bool:
        """Whether a side of the view begins to look past what is drawn; quiet: share of it that is still."""
        if quiet > STILL_SHARE and not self._stirred:
            return False
        self._stirred = quiet <= STILL_SHARE
        some = residual.modulation[::_SOME, ::_SOME][residual.flags[::_SOME, ::_SOME] == 0]
        if not len(some):
            return False
        at, amplitude = self._sides, residual.modulation.reshape(-1, 2)
        bare = (amplitude[at] < BARE_CONTRAST * some.mean(axis=0)).all(axis=1)
        bare &= residual.flags.ravel()[at] & _LIGHT_LOST == 0
        past = np.add.reduceat(bare, self._side_starts, dtype=np.int64) > SIDE_SHARE * self._side_sizes
        begins = bool((past & ~self._past).any())
        self._past = past
        return begins

    def _as_one_piece(self, residual: Residual, expected: Expected) -> bool:
        """Whether the picture was displaced, turned and stretched more than bent, which a press does."""
        good: Mask = (residual.flags == 0) & np.isfinite(expected.residual_px[..., 0])
        change = (residual.d - expected.residual_px)[good]
        if not len(change):
            return False
        terms = np.column_stack([np.ones(len(change)), self._from_middle[good]])
        bent = change - terms @ np.linalg.lstsq(terms, change, rcond=None)[0]
        moved, off = (np.median(np.abs(one).max(axis=1)) for one in (change, bent))
        return bool(off < BENT_SHARE * moved)

    def _settle(self, observation: Observation, residual: Residual, still: bool) -> None:
        """Take in a frame after one in which all of the view moved a little: by that, or by periods more."""
        assert self._kept is not None
        if still:
            self._unsure = 0
            if _alone(observation, self._kept, ALIKE_PX):
                self._seen = residual.d.copy(), residual.valid.copy()
            else:
                self._larger = None
        elif self._unsure < SUDDEN_FRAMES:
            self._unsure += 1
        else:
            self._kept, self._larger, self._unsure, self._still = None, None, 0, False

    def _compare(self, observation: Observation, residual: Residual, expected: Expected) -> Expected | None:
        """The order by a frame of the picture that is kept and one of the enlarged one, in turn."""
        assert self._kept is not None
        wanted = self._kept if self._larger is None else self._larger
        alone = observation.mixture is None and _alone(observation, wanted, _SAME_LCD_PX)
        self._steady = self._steady + 1 if alone else 0
        if self._steady < (STEADY_FRAMES if self._failed else 1):
            return None
        self._steady = 0
        if self._seen is None or self._larger is None:
            self._seen = residual.d.copy(), residual.valid.copy()
            self._larger = self._enlarged(self._kept)
            return None
        d, valid = self._seen
        both: Mask = valid & residual.valid
        absolute, clear = self._absolute(d, residual.d, both)
        self._seen = self._larger = None
        clear &= both
        self._failed = not np.count_nonzero(clear) > CLEAR_SHARE * np.count_nonzero(both)
        if self._failed:
            return None
        self._kept = None
        absolute[~clear] = np.nan
        return Expected(expected.q, clear, absolute, absolute)

    def _enlarged(self, q: Float) -> Float:
        """The warp (rows, cols, 2) LCD px that draws the target larger by s where `q` draws it."""
        spacing_px, away = self._rest.grid.spacing_px, self._from_middle
        larger: Float = compose(q, away * (1 / (1 + ENLARGED) - 1), spacing_px) - self._rest.q
        inside: Mask = np.isfinite(larger[..., 0])
        out: Float = self._rest.q + continue_smoothly(larger, inside)
        return out

    def _absolute(self, d: Float, d_larger: Float, both: Mask) -> tuple[Float, Mask]:
        """(Residual (rows, cols, 2) against the enlarged picture, camera px; where its order is clear).

        both: nodes that both pictures were read at, which say how many periods all are off.
        """
        period, away = self._rest.grid.period_px, self._from_middle
        one = self._to_carriers(away + d)
        left = self._to_carriers(away + d_larger) - (1 + ENLARGED) * one
        orders = (left - period * np.rint(left / period)) / (ENLARGED * period)
        whole = np.rint(np.median(orders[both], axis=0)) if both.any() else np.zeros(2)
        expected = (1 + ENLARGED) * self._from_carriers(one + period * whole) - away
        return expected, (np.abs(orders - whole) < CLEAR).all(axis=-1)

    def _to_carriers(self, d: Float) -> Float:
        return np.stack([d[..., 0] + d[..., 1], d[..., 0] - d[..., 1]], axis=-1) if self._diagonal else d

    def _from_carriers(self, d: Float) -> Float:
        return 0.5 * self._to_carriers(d) if self._diagonal else d


def _outermost(visible: Mask) -> list[Ints]:
    """Numbers of the outermost nodes on each of the four sides, of those visible (rows, cols)."""
    numbers = np.arange(visible.size).reshape(visible.shape)
    rows, cols = visible.any(axis=1), visible.any(axis=0)
    turned = (visible.T[cols], numbers.T[cols]), (visible[rows], numbers[rows])
    return [
        lines[np.arange(len(lines)), seen.argmax(axis=1)]
        for one, at in turned
        for seen, lines in ((one, at), (one[:, ::-1], at[:, ::-1]))
    ]


def _alone(observation: Observation, q: Float, within_px: float) -> bool:
    """Whether a frame saw only pictures within within_px of `q`, (rows, cols, 2) LCD px."""
    mixture = observation.mixture
    if mixture is not None:
        bias_px = mixture.bias_px
        if mixture.mixed.any() or bias_px is None or np.abs(bias_px).max() > within_px:
            return False
    return bool(np.abs(observation.shown.q - q).max() < within_px)


def _changes(d: Float, expected: Float, flags: Flags, quiet_px: float, jump_px: float) -> tuple[float, float]:
    """Shares of the valid nodes (rows, cols) that are as expected, and that jumped; camera px."""
    change = largest_change(d, expected)
    known = (flags == 0) & np.isfinite(change)
    quiet, jumped = known & (change < quiet_px), known & (change > jump_px)
    nodes = max(int(np.count_nonzero(known)), 1)
    return int(np.count_nonzero(quiet)) / nodes, int(np.count_nonzero(jumped)) / nodes
