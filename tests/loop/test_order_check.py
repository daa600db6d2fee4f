"""Which period of the carrier is seen, found by one enlarged picture: planted displacements, and a run."""

from __future__ import annotations

import numpy as np
import pytest
from node_bench import PERIOD_PX, SIGMA_PX, rest_warp

from benchmarks.rigs import VIEW_MIDDLE_MM, opened, pressed, step_path
from zeromethod import load_rig
from zeromethod.devices.protocols import Frame
from zeromethod.exposure.pairing import Observation
from zeromethod.loop.measured_warp import Expected
from zeromethod.loop.order_check import ENLARGED, LONGEST_S, STEADY_FRAMES, SUDDEN_FRAMES, Order, OrderCheck
from zeromethod.loop.state import State
from zeromethod.sensing.residual import Residual
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Role, Warp

REST = rest_warp()
U, V = REST.grid.mesh()
MIDDLE = np.array([0.5 * (U[0, 0] + U[-1, -1]), 0.5 * (V[0, 0] + V[-1, -1])])
FRAME_NS = round(1e9 / 60)


class View:
    """Frames of a mirror that displaces the picture of rest by `d` (rows, cols, 2) camera px.

    late: frames from what is asked for to the one that sees it. What is expected is what was seen last.
    """

    def __init__(self, diagonal: bool = False, late: int = 0) -> None:
        self.check = OrderCheck(REST, diagonal=diagonal)
        self.diagonal = diagonal
        self.draw = np.random.default_rng(3)
        self.frames = 0
        self.last = np.zeros_like(REST.q)
        self.asked: list[np.ndarray | None] = [None] * late

    def wrapped(self, d: np.ndarray) -> np.ndarray:
        """What the sensor reads: neighbours agree on their periods, and all are brought near to zero."""
        carriers = np.stack([d[..., 0] + d[..., 1], d[..., 0] - d[..., 1]], axis=-1) if self.diagonal else d
        carriers = carriers - PERIOD_PX * np.rint(np.median(carriers[REST.visible], axis=0) / PERIOD_PX)
        if self.diagonal:
            carriers = 0.5 * np.stack(
                [carriers[..., 0] + carriers[..., 1], carriers[..., 0] - carriers[..., 1]], axis=-1
            )
        return carriers + SIGMA_PX * self.draw.standard_normal(d.shape)

    def look(
        self, d: np.ndarray, every_ns: int = FRAME_NS, flags: np.ndarray | None = None
    ) -> Expected | None:
        """One frame of what the check wants to be shown: the target at rest, or enlarged.

        flags: (rows, cols) that nodes carry besides; those without a carrier have no contrast.
        """
        self.asked.append(self.check.commanded)
        shown = self.asked.pop(0)
        larger = shown is not None and not np.array_equal(shown, REST.q)
        away = np.stack([U, V], axis=-1) - MIDDLE
        true, expected = ((1 + ENLARGED) * (away + one) - away if larger else one for one in (d, self.last))
        self.last = d
        residual = Residual.empty(REST.grid)
        residual.d[:], residual.sigma[:], residual.modulation[:] = self.wrapped(true), SIGMA_PX, 1.0
        residual.flags[:] = np.where(REST.visible, 0, residual.flags)
        if flags is not None:
            residual.flags[:] |= flags.astype(np.uint16)
            residual.modulation[flags & Flag.MODULATION > 0] = 0.0
        self.frames += 1
        warp = Warp.drawn(REST.q if shown is None else shown, Role.SHOWN, self.frames * every_ns)
        frame = Frame(np.zeros((1, 1), np.uint8), warp.time_ns, 8_000_000, self.frames)
        seen = Observation(frame, warp, None, np.zeros(1, np.int64), np.ones((1, 1)), None)
        expected = np.where(REST.visible[..., None], self.wrapped(expected), np.nan)
        return self.check.look(seen, residual, Expected(REST.q, REST.visible, expected, expected))

    def order(self, every_ns: int = FRAME_NS) -> Order:
        return self.check.order(self.frames * every_ns)


def plane(du_px: float, dv_px: float, steep: float) -> np.ndarray:
    """Displacement of the whole view that also grows across it."""
    return np.stack([du_px + steep * (U - MIDDLE[0]), dv_px - steep * (V - MIDDLE[1])], axis=-1)


@pytest.mark.parametrize("diagonal", [False, True])
@pytest.mark.parametrize("periods", [(1.0, 0.0), (-2.0, 1.0), (0.5, 3.5), (-7.3, 6.1)])
def test_whole_periods_are_found_by_the_enlarged_picture(periods, diagonal):
    view, d = View(diagonal), plane(PERIOD_PX * periods[0], PERIOD_PX * periods[1], 0.02)
    assert view.look(d) is None
    assert view.order() is Order.DOUBTED
    found = view.look(d)
    assert view.order() is Order.KNOWN
    away = np.stack([U, V], axis=-1) - MIDDLE
    true = (1 + ENLARGED) * (away + d) - away
    # noise of the first frame comes in enlarged; a wrong order would be off by a period
    np.testing.assert_allclose(found.residual_px[found.trusted], true[found.trusted], atol=8 * SIGMA_PX)
    assert np.count_nonzero(found.trusted) > 0.99 * np.count_nonzero(REST.visible)


def test_where_a_quarter_of_the_view_is_at_rest_nothing_is_doubted():
    d = plane(6.0, 0.0, 0.0)
    d[: U.shape[0] // 2] = 0.0
    view = View()
    assert view.look(d) is None
    assert view.order() is Order.KNOWN
    assert view.check.commanded is None


def test_a_jump_of_the_whole_view_is_doubted_and_slow_motion_is_not():
    view = View()
    view.look(plane(0.0, 0.0, 0.0))
    view.look(plane(0.2, 0.0, 0.0))
    assert view.order() is Order.KNOWN
    view.look(plane(5.0, 0.0, 0.0))
    assert view.order() is Order.DOUBTED


@pytest.mark.parametrize(("frames", "until_found"), [(1, 3), (2, 8)])
@pytest.mark.parametrize("away_px", [(1.9, -1.0), (0.6, 0.6), (-1.0, 0.0)])
def test_a_jump_by_whole_periods_to_within_an_eighth_is_found(away_px, frames, until_found):
    """Phase shows what is left over alone: the view moves a little, and is still again."""
    d = plane(2 * PERIOD_PX + away_px[0], away_px[1] - PERIOD_PX, 0.0)
    view = View(late=2)
    for _ in range(3):
        view.look(plane(0.0, 0.0, 0.0))
    on_the_way = plane(PERIOD_PX + 0.5 * away_px[0], 0.5 * away_px[1], 0.0)
    for moved in (d,) if frames == 1 else (on_the_way, d):
        assert view.look(moved) is None
        assert view.order() is Order.DOUBTED
    found = next(one for one in (view.look(d) for _ in range(until_found)) if one is not None)
    assert view.order() is Order.KNOWN
    away = np.stack([U, V], axis=-1) - MIDDLE
    true = (1 + ENLARGED) * (away + d) - away
    np.testing.assert_allclose(found.residual_px[found.trusted], true[found.trusted], atol=8 * SIGMA_PX)


def test_a_press_that_leaves_a_tenth_of_the_view_still_is_not_doubted_and_motion_that_goes_on_for_a_moment():
    view, press = View(late=2), plane(1.0, 0.0, 0.0)
    press[: U.shape[0] // 5] = 0.0
    for d in (0 * press, press, press):
        view.look(d)
        assert view.order() is Order.KNOWN
    doubted = [view.look(press + 0.5 * k) or view.order() is Order.DOUBTED for k in range(1, 12)]
    assert doubted == [True] * SUDDEN_FRAMES + [False] * (11 - SUDDEN_FRAMES)


def test_a_side_that_looks_past_what_is_drawn_is_doubted_though_the_rest_seems_bent_by_a_press():
    """Seven periods: phase shows what the rest of them differs by, which is nothing in a part of the view.

    A side that goes dark, as where something presses, says nothing, nor does half a side.
    """
    bent = np.stack([2 * (U - U.min()) ** 2 / np.ptp(U) ** 2, 0 * U], axis=-1)
    d, side = 7 * PERIOD_PX * np.array([1.0, 0.0]) + bent, np.zeros(U.shape, np.uint16)
    side[:, -14:] = Flag.MODULATION
    half, dark = np.where(MIDDLE[1] < V, side, 0), np.where(side > 0, side | Flag.LIGHT_LOST, 0)
    for flags, doubted in ((side, True), (half, False), (dark, False)):
        view = View()
        for _ in range(3):
            view.look(plane(0.0, 0.0, 0.0))
        view.look(d, flags=flags)
        assert (view.order() is Order.DOUBTED) is doubted
        if doubted:
            found = view.look(d, flags=flags)
            away = np.stack([U, V], axis=-1) - MIDDLE
            true = (1 + ENLARGED) * (away + d) - away
            np.testing.assert_allclose(
                found.residual_px[found.trusted], true[found.trusted], atol=8 * SIGMA_PX
            )
            # once found it is not doubted again while that side stays as it is
            assert view.look(d, flags=flags) is None
            assert view.order() is Order.KNOWN


def test_order_is_doubted_after_a_gap_without_frames():
    view = View()
    view.look(plane(0.0, 0.0, 0.0))
    view.frames += 30
    view.look(plane(1.0, 0.0, 0.0))
    assert view.order() is Order.DOUBTED


def test_while_the_mirror_moves_nothing_is_found_and_after_a_second_it_is_said_to_be_unknown():
    view = View()
    moving = (plane(5.0 + 0.25 * k, 0.0, 0.0) for k in range(100))
    while view.frames < LONGEST_S * 60:
        assert view.look(next(moving)) is None
    assert view.order() is Order.DOUBTED
    view.look(next(moving))
    view.look(next(moving))
    assert view.order() is Order.UNKNOWN
    # it settles, and is found
    found = [view.look(plane(5.0, 0.0, 0.0)) for _ in range(6 * STEADY_FRAMES)]
    assert any(one is not None for one in found)
    assert view.order() is Order.KNOWN


@pytest.mark.parametrize(("press_s", "depth_mm"), [(0.0, 2.5), (0.15, 1.86)])
def test_a_press_that_moves_the_whole_view_by_periods_is_nulled_at_the_right_order(press_s, depth_mm):
    """A dent as wide as the prism, half of it out of view.

    There from the start it moves the picture by 46 px, three periods of 16; suddenly, by two and 2 px.
    """
    at = VIEW_MIDDLE_MM + 90.0, 0.0
    with pressed(load_rig("simulated"), step_path(press_s, depth_mm), 100.0, at) as rig, opened(rig) as bench:
        *_, step = bench.loop.run(frames=round(60 * press_s) + 20)
        moved = bench.true_warp(bench.truth(step.time_ns))
    assert step.measured is not None
    assert step.residual_rms_px < 0.05
    # nulled, and taken for a camera that moved, as such a press leaves nothing of the view at rest
    assert step.state in {State.LOCKED, State.MOVED}
    valid = step.measured.valid
    assert np.count_nonzero(valid) > 0.9 * np.count_nonzero(bench.loop.rest.visible)
    off = np.abs(step.measured.q - moved)[valid]
    assert np.abs(moved - bench.loop.q_rest)[valid].max() > PERIOD_PX
    # noise of a frame is 0.01 LCD px
    assert np.percentile(off, 99.9) < 0.1
