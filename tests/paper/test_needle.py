import json

import numpy as np
import pytest

from zeromethod.paper.needle import PAPER_DEPTH_ERROR_PX, PAPER_THETA_ERROR_RAD, Needle, column
from zeromethod.paper.needle_reading import MM_PER_PX, read_needle, reproduce_needle
from zeromethod.view.paper_figures import draw_needle_figures


@pytest.fixture(scope="module")
def result():
    return reproduce_needle()


def test_the_needle_is_a_tent_of_forty_px_with_straight_flanks():
    needle = Needle()
    at = np.array([0.0, 400.0, 818.5, 1637.0])
    np.testing.assert_allclose(needle.depth(at), [0.0, 40 * 400 / 818.5, 40.0, 0.0], atol=1e-12)
    step = (needle.depth(at[1:2] + 1e-3) - needle.depth(at[1:2]))[0] / 1e-3
    assert np.tan(needle.theta(at[1:2]))[0] == pytest.approx(step, rel=1e-9)


def test_equation_17_on_its_own_model_stays_within_the_papers_bounds(result):
    for series in (result.printed.rises, result.printed.drops, result.printed.average):
        assert series.theta_rad < PAPER_THETA_ERROR_RAD
        assert series.depth_px < PAPER_DEPTH_ERROR_PX
    theta = np.arctan(40 / 818.5)
    # what the expansion leaves, (8/3) theta^3 and 10 % of higher orders, and its sum up to the tip
    assert result.printed.average.theta_rad == pytest.approx(8 / 3 * theta**3, rel=0.15)
    assert result.printed.average.depth_px == pytest.approx(8 / 3 * theta**3 * 818.5, rel=0.15)


@pytest.mark.parametrize("spacing_px", [1.0, 4.0, 6.0])
def test_the_depth_bound_holds_for_other_spacings_too(spacing_px):
    found = column(Needle(), exact=False, invert="equation 17", spacing_px=spacing_px)
    assert max(found.rises.depth_px, found.drops.depth_px, found.average.depth_px) < PAPER_DEPTH_ERROR_PX


def test_equation_17_fails_on_exact_geometry_and_equation_12_does_not(result):
    # gamma = theta on the first flank: half of delta alpha is missing
    assert result.exact_17.average.depth_px > 10.0
    # the interval that holds the tip turns by 2 x 49 mrad: at most half a spacing times that
    assert result.exact_12.average.depth_px < 0.5 * result.spacing_px * 2 * 40 / 818.5


def test_the_own_reading_is_a_hundred_times_closer_than_the_papers_bounds(result):
    errors = result.zero_method.errors
    assert errors.depth_away_px <= PAPER_DEPTH_ERROR_PX / 100
    assert errors.theta_away_rad <= PAPER_THETA_ERROR_RAD / 100


def test_the_own_readings_error_is_the_window_across_the_kink(result):
    half = read_needle(result.needle, MM_PER_PX / 2).errors.depth_away_px
    # in proportion to the window, but for where the kink lies between nodes
    assert result.coarse.errors.depth_away_px / half == pytest.approx(2.0, rel=0.25)
    slope = 40 / 818.5
    assert result.coarse.errors.depth_away_px == pytest.approx(
        1.2 * slope**2 * result.coarse.window_px, rel=0.25
    )


def test_figures_are_json_and_hold_every_column_beside_the_paper(result):
    figures = json.loads(json.dumps(result.figures()))
    assert figures["paper"]["theta_max_error_rad"] == 0.0008
    assert figures["equation_17_gamma_0"]["depth_max_error_px"] == pytest.approx(
        max(
            figures["equation_17_gamma_0"][part]["depth_max_error_px"]
            for part in ("rises", "drops", "average")
        )
    )
    assert figures["zero_method"]["depth_times_below_paper"] > 100


def test_figures_five_to_nine_are_drawn(result, tmp_path):
    paths = draw_needle_figures(result, tmp_path)
    assert [path.name for path in paths] == [f"figure-{n:02d}.png" for n in range(5, 10)]
    for path in paths:
        assert path.read_bytes().startswith(b"\x89PNG")
