import numpy as np
import pytest
from surface_bench import Bench, Gauss, Several, Tail, small_rig

from zeromethod.rig.model import KnownRest
from zeromethod.surface.anchor import mean_noise_gain


def read(bench, dent, generator=None):
    """The surface, and the multiple of h in its depth's error, mm at the view's middle (h = 1)."""
    surface = bench.reader.read(bench.warp(dent, generator))
    h = bench.reader.scale[surface.valid[bench.grid.inner]]
    return surface, float((bench.error(surface, dent) * h).sum() / (h * h).sum())


@pytest.mark.parametrize("dx", [-32.0, -25.0, -6.0, 6.0, 15.0, 25.0, 32.0])
@pytest.mark.parametrize("y", [0.0, 10.0, 18.0])
def test_a_press_near_or_over_the_border_does_not_move_zero(small, dx, y):
    dent = Gauss(0.2, small.centre_mm + dx, y, 5.0)
    surface, wrong = read(small, dent)
    assert surface.anchor.mode == "quiet"
    # bar 0.1 um
    assert abs(wrong) < 1e-4
    assert small.truth(dent)[surface.anchor.mask].max() < 1e-3


def test_two_presses_leave_zero_where_it_was(small):
    dent = Several((Gauss(0.2, 25.0, 5.0, 4.0), Gauss(0.15, 55.0, -8.0, 4.0)))
    assert abs(read(small, dent)[1]) < 1e-4


def test_a_flat_top_over_the_border_is_outvoted(small):
    """A plateau at the border has no slope either; the larger quiet part counts as rest."""

    class Plateau:
        def depth(self, x, y):
            return 0.1 / (1 + np.exp(((x - 60.0) ** 2 + (y - 12.0) ** 2 - 100.0) / 25.0))

        def slope(self, x, y):
            d = self.depth(x, y)
            factor = -d * (1 - d / 0.1) * 2 / 25.0
            return factor * (x - 60.0), factor * (y - 12.0)

    assert abs(read(small, Plateau())[1]) < 2e-4


@pytest.mark.parametrize("dx", [-6.0, 0.0, 9.0])
def test_a_far_field_that_never_ends_is_followed_by_its_law(small, dx):
    """1/r all over the view: 13 um of depth where the view ends, known to a thousandth by slope and depth."""
    dent = Tail(0.2, small.centre_mm + dx, 0.0, 3.0)
    surface, offset = read(small, dent)
    wrong = abs(offset)
    assert small.truth(dent)[surface.anchor.mask].min() > 5e-3
    # 1 um (by noise and by the core's size of 3 mm, which the law has not) of 11 to 32 um, as stated
    assert wrong < 2 * surface.anchor.sigma_mm < 1.5e-3
    assert wrong < 1e-4
    assert surface.anchor.far_field_mm > 5e-3


@pytest.mark.parametrize("sigma_mm", [9.0, 12.0, 15.0, 18.0])
def test_a_gaussians_skirt_is_followed_by_its_law(small, sigma_mm):
    dent = Gauss(0.2, small.centre_mm + 1.7, 2.0, sigma_mm)
    surface, offset = read(small, dent)
    wrong = abs(offset)
    # the border taken for at rest is off by 0.3 to 117 um; what is left of that is second order in it
    assert wrong < 1e-2 * small.truth(dent)[surface.anchor.mask].max()
    assert wrong < 2 * surface.anchor.sigma_mm + 1e-6
    assert surface.anchor.sigma_mm < 5e-3


def test_the_next_frame_starts_from_the_tail(small):
    dent = Tail(0.2, small.centre_mm, 0.0, 3.0)
    warp = small.warp(dent)
    cold = small.reader.read(warp)
    warm = small.reader.read(warp, cold)
    assert warm.iterations < cold.iterations
    apart = np.abs(warm.depth_mm - cold.depth_mm)[cold.valid].max()
    assert apart < 2 * cold.anchor.sigma_mm


def test_what_follows_no_law_goes_into_sigma(small):
    """A 1/r dent in a bulge twice as wide: depth changes its sign on the way out."""
    dent = Several((Tail(0.2, small.centre_mm, 0.0, 3.0), Gauss(-0.05, small.centre_mm, 0.0, 12.0)))
    surface, offset = read(small, dent)
    assert 1e-3 < abs(offset) < 2 * surface.anchor.sigma_mm


def test_random_presses_lie_within_the_stated_sigma(small):
    """Pads of any width and place, two at a time, and 1/r dents, with one frame's noise."""
    generator = np.random.default_rng(4)
    covered = []
    for _ in range(60):
        x, y = small.centre_mm + generator.uniform(-14, 14), generator.uniform(-12, 12)
        kind, width = generator.integers(3), generator.uniform(3.0, 13.0)
        peak = 0.033 * width * generator.uniform(0.1, 1.0)
        dent = Gauss(peak, x, y, width)
        if kind == 1:
            dent = Tail(0.3 * peak, x, y, 0.5 * width)
        if kind == 2:
            other_x, other_y = small.centre_mm + generator.uniform(-16, 16), generator.uniform(-14, 14)
            dent = Several((Gauss(0.5 * peak, x, y, width), Gauss(0.5 * peak, other_x, other_y, width)))
        surface, offset = read(small, dent, generator)
        # noise of the depth itself: 60 nm at a node of this coarse bench
        covered.append(abs(offset) < 2 * np.hypot(surface.anchor.sigma_mm, 6e-5))
    assert np.mean(covered) >= 0.93  # 95 % of 60, less one deviation (3 %)


def test_a_dent_that_fills_the_view_is_not_called_certain(small):
    surface, offset = read(small, Gauss(0.2, small.centre_mm, 0.0, 24.0))
    assert surface.anchor.sigma_mm > 0.5 * abs(offset)


WIDE = [Gauss(0.3, 58.3, -1.9, 28.2), Gauss(0.3, 55.7, 1.0, 26.3), Gauss(0.17, 70.8, 9.3, 26.7)]


@pytest.mark.parametrize("dent", WIDE)
def test_wide_presses_near_the_views_end_are_read_within_sigma(small, dent):
    """110 to 150 um at the border: their centre is not where slopes with the constant's own point."""
    for seed in range(2):
        surface, offset = read(small, dent, np.random.default_rng(seed))
        assert abs(offset) < 3 * surface.anchor.sigma_mm
        assert surface.anchor.sigma_mm < 0.2 * small.truth(dent)[surface.anchor.mask].max()


def test_a_tail_that_the_constant_hides_from_the_slopes_is_found(small):
    """C grad h may cancel the slopes of 1/r at the border: they look at rest, 5 um deep."""
    dent = Tail(0.1, 74.0, -8.0, 3.0)
    surface, offset = read(small, dent, np.random.default_rng(1))
    assert small.truth(dent)[surface.anchor.mask].min() > 3e-3
    assert abs(offset) < 3 * np.hypot(surface.anchor.sigma_mm, 6e-5)


@pytest.mark.parametrize(
    "dent",
    [
        Gauss(0.15, 60.0, 14.0, 9.0),
        Gauss(0.15, 42.0, -20.0, 14.0),
        Tail(0.1, 20.0, 14.0, 3.0),
    ],
)
def test_fresh_noise_leaves_the_anchors_sigma_much_the_same(small, dent):
    found = [read(small, dent, np.random.default_rng(seed)) for seed in range(5)]
    sigmas = [float(np.hypot(surface.anchor.sigma_mm, 6e-5)) for surface, _ in found]
    assert max(sigmas) < 2.0 * min(sigmas)
    assert max(abs(offset) for _, offset in found) < 3.0 * max(sigmas)


def test_known_rest_is_used_where_it_is_in_view():
    rim = KnownRest(x_mm=(66.0, 77.0), y_mm=(-30.0, 30.0))
    bench = Bench(small_rig(known_rest=(rim,)))
    surface, _ = read(bench, Tail(0.2, bench.centre_mm, 0.0, 3.0))
    assert surface.anchor.mode == "known"
    # this rim is not at rest, and sigma says so: beyond the 60 nm of noise, as much as its depths differ
    assert 0.3 * surface.depth_mm[surface.anchor.mask].std() < surface.anchor.sigma_mm
    assert surface.x_mm[surface.anchor.mask].min() >= 65.9
    # the rim itself is not at rest under this tail: its mean is what is taken off
    assert abs(surface.depth_mm[surface.anchor.mask].mean()) < 1e-3


def test_known_rest_out_of_sight_falls_back_to_the_quietest():
    bench = Bench(small_rig(known_rest=(KnownRest(x_mm=(200.0, 210.0), y_mm=(0.0, 1.0)),)))
    assert read(bench, Gauss(0.2, bench.centre_mm, 0.0, 5.0))[0].anchor.mode == "quiet"


def test_noise_of_a_mean_of_correlated_nodes():
    assert mean_noise_gain(np.array([1.0]), 5) == pytest.approx(0.2)
    assert mean_noise_gain(np.ones(9), 5) == pytest.approx(1.0)
    assert mean_noise_gain(np.array([1.0, 0.5]), 2) == pytest.approx(0.75)
