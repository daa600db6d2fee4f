import numpy as np
import pytest

from zeromethod.rig.model import Noise
from zeromethod.sensing import Residual, ResidualSensor
from zeromethod.sensing.known_order import BORDER_SHARE, settle_known_order
from zeromethod.sensing.unwrap import Unwrapper, unwrap_orders
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.validity import Flag

from .sensing_scenes import GRID, INNER, PERIOD, at_nodes, bump, checker, cosines, observed
from .sensing_scenes import camera as noisy

NOISE = Noise(read_grey=2.0, black_grey=4.0)
NODES = tuple(n - 8 for n in GRID.shape)


@pytest.fixture(scope="module")
def sensor():
    return ResidualSensor(GRID, "cosines", NOISE, 8)


def press(peak_u, peak_v, width=39.0, centre=(160, 128)):
    """Peak displacement 40 px at width 39 px: up to 5 px from node to node."""
    return peak_u * bump(width, centre), peak_v * bump(width, centre)


def camera(light, seed=1):
    return noisy(light, seed, NOISE)


def unwrapped(sensor, light, du, dv, seed=1, least_valid=0.95):
    """The residual, of which enough is valid and no valid node is an order off."""
    residual = sensor.measure(camera(light, seed))
    valid = residual.valid[INNER]
    error = residual.d[INNER] - np.stack([at_nodes(du), at_nodes(dv)], axis=-1)
    assert valid.mean() > least_valid
    assert not ((np.abs(error) > PERIOD / 2).any(axis=-1) & valid).any()
    return residual


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_sudden_press_of_two_and_a_half_periods(sensor, seed):
    field = press(40.0, -30.0)
    # the steepest ring (strain above shading.LARGEST_STRAIN) may be taken for an edge of the light: 2.3 %
    residual = unwrapped(sensor, observed(cosines, *field), *field, seed, least_valid=0.97)
    assert np.abs(residual.d[INNER]).max() > 35


@pytest.mark.parametrize("hole", [(slice(70, 110), slice(180, 230)), (slice(110, 150), slice(140, 190))])
def test_press_with_a_dark_hole_next_to_or_at_its_peak(sensor, hole):
    field = press(40.0, -30.0)
    light = observed(cosines, *field)
    light[hole] = 0.0
    unwrapped(sensor, light, *field, least_valid=0.85)


def test_press_that_reaches_the_border(sensor):
    field = press(34.0, 20.0, centre=(290, 128))
    unwrapped(sensor, observed(cosines, *field), *field)


def test_checker_is_unwrapped_along_its_diagonals():
    field = press(22.0, -12.0, 45.0)
    sensor = ResidualSensor(GRID, "checker", NOISE, 8)
    unwrapped(sensor, observed(checker, *field, samples=3), *field)


def planted(du, dv, grid=GRID):
    """Residual with exact displacements, wrapped."""
    residual = Residual.empty(grid)
    d = np.stack([du, dv], axis=-1)
    residual.d[grid.inner] = d - PERIOD * np.rint(d / PERIOD)
    residual.sigma[grid.inner] = 0.01
    residual.flags[grid.inner] = 0
    return residual


def ring(inner, outer):
    """Nodes between two distances (nodes) from the middle of the grid."""
    rows, cols = NODES
    y, x = np.indices(NODES)
    distance = np.hypot(x - cols // 2, y - rows // 2)
    return (distance >= inner) & (distance < outer), distance < inner


def test_island_is_ambiguous_unless_guessed():
    hole, island = ring(5, 8)
    du = np.where(island, 15.0, 0.2)
    flags = np.where(hole, Flag.MODULATION, 0).astype(np.uint16)

    def measured(guess):
        residual = planted(du, 0 * du)
        residual.flags[INNER] |= flags
        Unwrapper(GRID, diagonal=False).unwrap(residual, guess)
        return residual

    alone = measured(None)
    assert (alone.flags[INNER][island] == Flag.AMBIGUOUS).all()
    assert (alone.flags[INNER][~island & ~hole] == 0).all()
    guess = np.full((*GRID.shape, 2), np.nan)
    guess[INNER][island] = (13.0, 0.0)
    guided = measured(guess)
    assert guided.valid[INNER][island].all()
    assert guided.d[INNER][island][:, 0] == pytest.approx(15.0)
    # a guess that is not within a quarter period decides nothing
    guess[INNER][island] = (9.0, 0.0)
    assert (measured(guess).flags[INNER][island] == Flag.AMBIGUOUS).all()


def test_strips_that_seams_part_are_each_brought_nearest_to_rest():
    u = np.broadcast_to(np.arange(NODES[1], dtype=float), NODES)
    strip = np.digitize(u, np.linspace(0, NODES[1], 6)[1:-1])
    hole = np.abs(np.diff(strip, axis=1, append=strip[:, -1:])) > 0
    du = 0.4 * (u - 0.5 * NODES[1])
    flags = np.where(hole, Flag.LIGHT_LOST, 0).astype(np.uint16)

    def measured(parted):
        residual = planted(du, 0 * du)
        residual.flags[INNER] |= flags
        Unwrapper(GRID, diagonal=False, parted=parted).unwrap(residual)
        return residual.flags[INNER], residual.d[INNER][..., 0]

    # each strip has less of the view's border than settles an order
    assert (measured(parted=False)[0][~hole] == Flag.AMBIGUOUS).all()
    seen, d = measured(parted=True)
    assert (seen[~hole] == 0).all()
    for number in range(5):
        one = ~hole & (strip == number)
        periods = (d - du)[one] / PERIOD
        assert np.ptp(periods) < 1e-6
        assert periods[0] == pytest.approx(np.rint(periods[0]), abs=1e-6)
        assert abs(np.median(d[one])) < PERIOD


def test_guess_settles_a_displacement_of_the_whole_view():
    far = planted(np.full(NODES, 17.0), np.full(NODES, -33.0))
    far.d[INNER][0, 0] = 6.0  # far enough from null that the flood runs
    unwrapper = Unwrapper(GRID, diagonal=False)
    unwrapper.unwrap(far, np.broadcast_to([18.0, -30.0], (*GRID.shape, 2)))
    assert np.median(far.d[INNER], axis=(0, 1)) == pytest.approx([17.0, -33.0])


def test_steps_of_half_a_period_keep_the_guess_s_order_under_noise():
    """As at the summit of a deep dent in an open loop, seen a frame ago but for a few nodes."""
    x = np.indices(NODES)[1] - NODES[1] // 2
    du = np.clip(8.2 * x, -34.0, 34.0)  # a period is 16
    guess = np.zeros((*GRID.shape, 2))
    guess[INNER][..., 0] = du
    noisy_u = du + np.random.default_rng(3).normal(0, 0.3, NODES)
    known = guess.copy()
    known[INNER][10:14, NODES[1] // 2] = np.nan
    residual = planted(noisy_u, 0 * du)
    Unwrapper(GRID, diagonal=False).unwrap(residual, known, guess)
    assert residual.valid[INNER].all()
    assert residual.d[INNER][..., 0] == pytest.approx(noisy_u)
    # the mirror that is at rest again takes nothing from a guess of before
    rested = planted(0 * du, 0 * du)
    rested.d[INNER][0, 0] = 6.0
    Unwrapper(GRID, diagonal=False).unwrap(rested, known, guess)
    assert np.abs(rested.d[INNER][1:]).max() == 0.0
    assert rested.valid[INNER][1:].all()


def test_nodes_round_a_residue_are_flagged():
    rows, cols = NODES
    y, x = np.indices(NODES)
    # a phase vortex: no order is consistent round its centre
    du = PERIOD * np.arctan2(y - rows / 2 + 0.5, x - cols / 2 + 0.5) / (2 * np.pi)
    residual = planted(du, 0 * du)
    Unwrapper(GRID, diagonal=False).unwrap(residual)
    near = np.hypot(y - rows / 2 + 0.5, x - cols / 2 + 0.5) < 1
    assert (residual.flags[INNER][near] & Flag.AMBIGUOUS).all()
    # and every pair of valid neighbours is continuous: the cut is flagged too
    d, valid = residual.d[INNER][..., 0], residual.valid[INNER]
    assert np.abs(np.diff(d, axis=0))[valid[1:] & valid[:-1]].max() < PERIOD / 2
    assert np.abs(np.diff(d, axis=1))[valid[:, 1:] & valid[:, :-1]].max() < PERIOD / 2


def test_too_steep_edges_carry_no_order():
    x = np.indices(NODES)[1]
    du = np.where(x < NODES[1] // 3, 0.0, 7.6)
    residual = planted(du, 0 * du)
    Unwrapper(GRID, diagonal=False).unwrap(residual)
    # both sides reach the border of the view with enough of it: each takes its own order
    assert residual.d[INNER] == pytest.approx(np.stack([du, 0 * du], axis=-1))
    narrow = np.where(x < 2, 7.6, 0.0)
    residual = planted(narrow, 0 * narrow)
    Unwrapper(GRID, diagonal=False).unwrap(residual)
    assert residual.valid[INNER][:, 2:].all()


def test_near_null_is_left_alone():
    residual = planted(*np.random.default_rng(0).uniform(-3.9, 3.9, (2, *NODES)))
    before = residual.copy()
    Unwrapper(GRID, diagonal=False).unwrap(residual)
    assert np.array_equal(residual.d, before.d)
    assert np.array_equal(residual.flags, before.flags)


def test_smallest_grid():
    grid = NodeGrid((64, 64), PERIOD)
    residual = ResidualSensor(grid, "cosines", NOISE, 8).measure(
        camera(observed(cosines, 6.0, 0.0, (64, 64)))
    )
    assert residual.d[grid.inner][..., 0] == pytest.approx(6.0, abs=0.1)


def test_near_the_null_what_dark_places_cut_off_is_flagged_as_by_unwrapping():
    """Nodes dark at random, few to most of them, and guesses missing in one place: islands of any size."""
    draw = np.random.default_rng(4)
    settled = flagged = 0
    for dark in np.linspace(0.0, 0.7, 40):
        residual = Residual.empty(GRID)
        residual.d[INNER] = draw.normal(0, draw.choice([0.2, 1.2]), (*NODES, 2))
        residual.sigma[INNER] = draw.uniform(0, 1.5, (*NODES, 2))
        residual.flags[INNER] = np.where(draw.random(NODES) < dark, Flag.LIGHT_LOST, 0)
        guess = draw.normal(0, 0.2, residual.d.shape)
        guess[10:20, 10:25] = np.nan
        expected = residual.copy()
        given = guess, guess, float(PERIOD), BORDER_SHARE
        unwrap_orders(expected.d, expected.sigma, expected.flags, *given)
        if settle_known_order(residual.d, residual.sigma, residual.flags, guess, float(PERIOD)):
            settled += 1
            flagged += np.count_nonzero(residual.flags == Flag.AMBIGUOUS)
            np.testing.assert_array_equal(residual.flags, expected.flags)
            np.testing.assert_array_equal(residual.d[residual.valid], expected.d[residual.valid])
    assert settled > 10
    assert flagged > 10
