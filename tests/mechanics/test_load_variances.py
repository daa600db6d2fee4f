"""Which of many possible loads press: planted ones in noise, nothing but noise, and a pull."""

from functools import cache

import numpy as np
import pytest

from zeromethod.mechanics.gaussian_load import HalfSpace, Loads
from zeromethod.mechanics.load_variances import learned_variances, spread_variances
from zeromethod.mechanics.possible_loads import possible_loads

LOW, HIGH, BLOCK_MM = np.array([10.0, -18.0]), np.array([66.0, 18.0]), 4.0
X, Y = (
    each.ravel() for each in np.meshgrid(*(np.arange(a, b, BLOCK_MM) for a, b in zip(LOW, HIGH, strict=True)))
)
NOISE = 3e-6
"""Of slopes of a block, about."""


def slopes_of(loads):
    """(data, loads) over the noise."""
    fields = HalfSpace().at(X, Y)(loads)
    return np.concatenate([fields[1], fields[2]]).astype(np.float64) / NOISE


@cache
def possible():
    loads = possible_loads(LOW, HIGH, BLOCK_MM)
    return loads, slopes_of(loads)


def pressed(*presses, seed=0):
    """Slopes over noise of loads (depth mm, x, y, width), with noise."""
    depth, *shape = np.array(presses, dtype=np.float64).reshape(-1, 4).T
    data = slopes_of(Loads(*shape)) @ depth if presses else np.zeros(2 * len(X))
    return data + np.random.default_rng(seed).standard_normal(len(data))


def means(gamma, data):
    """(loads,) expected depths, mm."""
    _, phi = possible()
    used = np.flatnonzero(gamma)
    out = np.zeros(len(gamma))
    out[used] = np.linalg.solve(
        phi[:, used].T @ phi[:, used] + np.diag(1 / gamma[used]), phi[:, used].T @ data
    )
    return out


def pressure(depth_mm, x, y):
    """Of all loads at places, over that of one 1 mm deep and 1 mm wide."""
    loads, _ = possible()
    apart2 = np.subtract.outer(x, loads.x_mm) ** 2 + np.subtract.outer(y, loads.y_mm) ** 2
    return np.exp(-0.5 * apart2 / loads.width_mm**2) @ (depth_mm / loads.width_mm)


PRESSES = {
    "one": [(0.05, 33.0, 3.0, 4.0)],
    "three": [(0.05, 25.0, -5.0, 3.6), (0.02, 48.0, 8.0, 5.0), (0.1, 52.0, -10.0, 8.0)],
    "outside": [(0.1, 40.0, 24.0, 6.0)],
}


@pytest.mark.parametrize("name", PRESSES)
@pytest.mark.parametrize("seed", range(3))
def test_planted_loads_are_found(name, seed):
    loads, phi = possible()
    data = pressed(*PRESSES[name], seed=seed)
    gamma = learned_variances(phi, data, loads)
    depth = means(gamma, data)
    q = depth * loads.q_mm2
    assert 0 < np.count_nonzero(gamma) < 0.1 * len(loads)
    # as well explained as noise is: chi2 of the data, less what the used loads take
    left = data - phi @ depth
    assert left @ left < len(data) + 4 * np.sqrt(2 * len(data))
    if name == "outside":
        # where nothing is seen, what stands for it presses within a width of where it does
        middle = np.array([q @ loads.x_mm, q @ loads.y_mm]) / q.sum()
        assert np.hypot(*(middle - PRESSES[name][0][1:3])) < PRESSES[name][0][3]
        return
    for _, x, y, _ in PRESSES[name]:
        planted = sum(
            depth_mm / width * np.exp(-0.5 * ((x - x0) ** 2 + (y - y0) ** 2) / width**2)
            for depth_mm, x0, y0, width in PRESSES[name]
        )
        # slopes are some thousand times the noise of a block, a width is three blocks or fewer
        assert pressure(depth, np.array([x]), np.array([y]))[0] == pytest.approx(planted, rel=0.01)


@pytest.mark.parametrize("name", PRESSES)
def test_what_they_make_of_depth_is_the_planted_depth(name):
    """Slopes say depth but for a constant; loads say that too."""
    loads, phi = possible()
    data = pressed(*PRESSES[name])
    depth = HalfSpace().at(X, Y)(loads)[0] @ means(learned_variances(phi, data, loads), data)
    presses = np.array(PRESSES[name]).T
    exact = HalfSpace().at(X, Y)(Loads(*presses[1:]))[0] @ presses[0]
    # noise of 3 urad over 300 data leaves 0.2 um of up to 100
    assert np.abs(depth - exact).max() < 0.02 * exact.max()


def test_in_noise_alone_nothing_presses():
    loads, phi = possible()
    found = [np.count_nonzero(learned_variances(phi, pressed(seed=seed), loads)) for seed in range(20)]
    # a load must gain 2 nats, by chance the best of a thousand does so in two fifths of all: 8 of these 20
    assert np.count_nonzero(found) < 10
    assert max(found) < 4


@pytest.mark.parametrize("presses", [*PRESSES.values(), [(-0.05, 33.0, 3.0, 4.0)]])
def test_no_load_pulls_where_nothing_presses(presses):
    """A sum of loads of both signs may explain what is seen, not one that pulls alone."""
    loads, phi = possible()
    data = pressed(*presses)
    depth = means(learned_variances(phi, data, loads), data)
    pulls = depth < 0.0
    found = pressure(depth, loads.x_mm[pulls], loads.y_mm[pulls])
    # others are estimated again after the last look at one: a hundredth of the largest pressure
    assert found.min(initial=0.0) > -0.01 * pressure(depth, loads.x_mm, loads.y_mm).max()


def test_a_dip_in_a_wide_press_is_taken_up():
    """Less pressure in the middle than around it is no pull."""
    loads, phi = possible()
    data = pressed((0.1, 38.0, 0.0, 9.0), (-0.015, 38.0, 0.0, 4.0))
    gamma = learned_variances(phi, data, loads)
    left = data - phi @ means(gamma, data)
    assert left @ left < len(data) + 4 * np.sqrt(2 * len(data))


def test_learning_again_from_what_was_learned_stays_there():
    loads, phi = possible()
    data = pressed(*PRESSES["three"])
    first = learned_variances(phi, data, loads)
    kept = first.copy()
    again = learned_variances(phi, data, loads, first)
    np.testing.assert_array_equal(first, kept)
    np.testing.assert_allclose(phi @ means(again, data), phi @ means(first, data), atol=1.0)


def test_variances_shared_with_neighbours_keep_their_sum():
    loads, _ = possible()
    gamma = np.zeros(len(loads))
    gamma[[20, len(loads) // 2, -3]] = 1e-4, 4e-3, 2e-5
    spread = spread_variances(gamma, loads)
    assert spread.sum() == pytest.approx(gamma.sum(), rel=1e-12)
    assert (spread >= 0.97 * gamma).all()
    # nearest in place, of the same width, takes more than what lies far from all of them
    middle, width = len(loads) // 2, loads.width_mm
    apart = np.hypot(*(at - at[middle] for at in (loads.x_mm, loads.y_mm)))
    beside = (apart < 1.1 * width) & (width == width[middle]) & (gamma == 0.0)
    assert beside.any()
    assert spread[beside].min() > 10 * spread[(apart > 5 * width[middle]) & (width <= width[middle])].mean()
    np.testing.assert_array_equal(spread_variances(np.zeros(len(loads)), loads), 0.0)
