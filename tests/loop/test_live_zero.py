"""Zeros that may be taken: slow, smooth, small drift; not a press, not a motion, not a hidden mirror."""

import numpy as np
import pytest
from node_bench import SIGMA_PX, dent, rest_warp

from zeromethod.loop.rest_memory import RestMemory
from zeromethod.loop.state import LOCK_RESIDUAL_PX
from zeromethod.loop.zero import FRAMES, LARGEST_LCD_PX, PATIENCE_FRAMES, NoZero, ZeroTaking
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

REST = rest_warp(256)
RNG = np.random.default_rng(5)
SIGMA_LCD_PX = 0.84 * SIGMA_PX


def warp(away: np.ndarray | float, hidden: np.ndarray | None = None) -> Warp:
    q = REST.q + away + SIGMA_LCD_PX * RNG.standard_normal(REST.q.shape)
    flags = np.where(REST.visible, np.uint16(0), np.uint16(Flag.OUTSIDE))
    if hidden is not None:
        flags[hidden] = Flag.MODULATION
    q[flags != 0] = np.nan
    return Warp(q, np.full_like(q, SIGMA_LCD_PX), flags, 0)


def taken(*aways: np.ndarray | float, hidden: np.ndarray | None = None) -> np.ndarray | str | None:
    """What comes of frames with these displacements."""
    taking = ZeroTaking(REST, REST.q, RestMemory(REST.grid.shape))
    for away in aways[:-1]:
        assert taking.take(warp(away, hidden), 0.01) is None
    return taking.take(warp(aways[-1], hidden), 0.01)


def drift(shift: float = 0.8, turn: float = 0.004, bend: float = 0.3) -> np.ndarray:
    """An LCD that slid, turned and warmed up, LCD px."""
    u, v = REST.grid.mesh()
    x, y = u - u.mean(), v - v.mean()
    bent = bend * (x / np.ptp(u)) ** 2
    return np.stack([shift + turn * y + bent, -0.5 * shift - turn * x], axis=-1)


def test_planted_drift_comes_back_to_the_noise_of_eight_frames():
    for away in (drift(), np.zeros_like(REST.q)):
        zero = taken(*[away] * FRAMES)
        assert isinstance(zero, np.ndarray)
        assert np.isfinite(zero).all()
        error = (zero - away)[REST.visible]
        assert error.std() == pytest.approx(SIGMA_LCD_PX / FRAMES**0.5, rel=0.1)
        # nodes that are not visible get the smooth part, at the rim of what it was fitted to
        assert np.abs(zero - away).max() < 0.05


@pytest.mark.parametrize(
    ("drifted", "press"),
    [
        *((0.3, (peak, sigma)) for peak in (0.5, 2.0, -2.0) for sigma in (16.0, 40.0)),
        (0.0, (1.0, 24.0, 70.0)),  # off the middle
    ],
)
def test_a_press_is_refused(drifted, press):
    away = drift(drifted, drifted / 300, drifted / 3) + dent(REST, *press)
    found = taken(*[away] * FRAMES)
    assert isinstance(found, NoZero)
    assert found.reason.startswith("something presses: a dent of")


def test_a_mirror_that_moves_is_refused():
    found = taken(*np.linspace(0, 1, FRAMES))
    assert found == NoZero("the mirror moves")
    slow = taken(*np.linspace(0, 0.05, FRAMES))  # 0.025 px between the halves: drift goes on as ever
    assert isinstance(slow, np.ndarray)


def test_too_much_is_no_drift():
    found = taken(*[drift(LARGEST_LCD_PX + 0.5)] * FRAMES)
    assert isinstance(found, NoZero)
    assert "more than drift (3)" in found.reason


def test_half_a_mirror_is_not_enough():
    hidden = np.zeros_like(REST.visible)
    hidden[: int(0.6 * len(hidden))] = True
    assert taken(*[0.0] * FRAMES, hidden=hidden) == NoZero("too much of the mirror is hidden")
    hidden[int(0.3 * len(hidden)) :] = False
    zero = taken(*[drift()] * FRAMES, hidden=hidden)
    assert isinstance(zero, np.ndarray)
    # continued by the quadratic form, which drift of that kind is
    assert np.abs(zero - drift()).max() < 0.05


def test_frames_that_are_not_nulled_do_not_count_and_patience_ends():
    taking = ZeroTaking(REST, REST.q, RestMemory(REST.grid.shape))
    for _ in range(FRAMES - 1):
        assert taking.take(warp(0.0), 0.01) is None
    for frame in range(FRAMES, PATIENCE_FRAMES):
        unusable = (None, float("nan")) if frame % 2 else (warp(1.0), LOCK_RESIDUAL_PX)
        assert taking.take(*unusable) is None
    assert taking.take(None, float("nan")) == NoZero(
        f"only {FRAMES - 1} of {PATIENCE_FRAMES} frames were nulled"
    )
