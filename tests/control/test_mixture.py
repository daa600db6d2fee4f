"""Planted mixes of two or three pictures, summed as carrier phasors, against what the closed form reads."""

import numpy as np
import pytest
from node_bench import LCD_PER_CAMERA, PERIOD_PX, _seen_at, dent, rest_warp

from zeromethod.control.mixture import Mixture, _arctan, _sine, mixture, unmix
from zeromethod.warp.compose import compose

REST = rest_warp(256)
GRID = REST.grid
INNER = GRID.inner
K = 2 * np.pi / PERIOD_PX
AXES = {"cosines": np.eye(2), "checker": np.array([[1.0, 1.0], [1.0, -1.0]])}


def read(
    pictures: list[np.ndarray], shares: list[float], truth: np.ndarray, kind: str = "cosines"
) -> tuple[np.ndarray, Mixture]:
    """(error of the warp read, camera px; the mixture) where `pictures` weigh `shares` in every row."""
    warps = np.stack([REST.q + one for one in pictures])
    q = np.tensordot(shares, warps, 1)
    seen = np.stack([_seen_at(REST, one, REST.q + truth) for one in warps])
    along = seen @ AXES[kind].T
    phasor = np.tensordot(shares, np.exp(1j * K * along), 1)
    # the order as a perfect unwrapper has it: that of the picture that outweighs the others
    main = along[int(np.argmax(shares))]
    along = main + np.angle(phasor * np.exp(-1j * K * main)) / K
    d = along @ np.linalg.inv(AXES[kind]).T
    weights = np.tile(shares, (257, 1))
    place = np.full(q.shape[:2], 100.5)
    mixed = mixture(warps, np.arange(len(warps)), weights, place, q, GRID.spacing_px, PERIOD_PX, kind)
    assert mixed.bias_px is not None
    measured = compose(q, unmix(d, mixed.bias_px, GRID.spacing_px), GRID.spacing_px)
    return (measured - REST.q - truth) / LCD_PER_CAMERA, mixed


def largest(error: np.ndarray, mixed: np.ndarray) -> float:
    good = ~mixed
    good[: INNER[0].start + 1] = good[:, : INNER[1].start + 1] = False
    good[INNER[0].stop - 1 :] = good[:, INNER[1].stop - 1 :] = False
    assert good.any()
    return float(np.abs(error[good]).max())


@pytest.mark.parametrize("kind", ["cosines", "checker"])
@pytest.mark.parametrize("shares", [[0.25, 0.75], [0.5, 0.5], [0.9, 0.1], [0.2, 0.5, 0.3]])
@pytest.mark.parametrize("spread_px", [1.5, 3.0, 5.0])
def test_planted_mixes_are_read_as_if_there_were_one_picture(
    kind: str, shares: list[float], spread_px: float
) -> None:
    peak = spread_px * LCD_PER_CAMERA
    pictures = [dent(REST, peak * k / (len(shares) - 1)) for k in range(len(shares))]
    error, mixed = read(pictures, shares, dent(REST, 0.7 * peak), kind)
    print(kind, shares, spread_px, largest(error, mixed.mixed), mixed.mixed.mean())
    # what is left is third order in s over the dent's width (5 nodes): (5 / 40)^2 of 5 px, and less below
    assert largest(error, mixed.mixed) < 0.02 * (spread_px / 5) ** 2
