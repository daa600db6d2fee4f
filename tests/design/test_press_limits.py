"""Largest presses: the fold of the exact rays, total reflection by its own closed form, refusals."""

import numpy as np
import pytest

from zeromethod.design import PressKind, SampledView, press_limit
from zeromethod.design.lever import gaussian_fold_mm
from zeromethod.design.press_limits import nulled_mm
from zeromethod.errors import InputError
from zeromethod.simulation.press import Shape

from .design_benches import telecentric

PATH_MM = 23.0
FINE_LCD = {"pitch_mm": 0.02, "columns": 4000, "rows": 2000}
X_MM = PATH_MM / np.sin(np.radians(50.0))


@pytest.fixture(scope="module")
def fine() -> SampledView:
    """Nodes 0.19 mm apart on the mirror round the point whose path is 23 mm."""
    angle = np.radians(50.0)
    away = 150.0 * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    look = np.array([X_MM, 0.0, 0.0])
    camera = {"look_at_mm": tuple(look), "position_mm": tuple(look + away)}
    return SampledView(telecentric(pixel_mm=0.03, camera=camera, target={"period_px": 8}, display=FINE_LCD))


@pytest.mark.parametrize(("sigma_mm", "folds_mm"), [(1.0, 0.031), (2.0, 0.117)])
def test_a_gaussian_folds_where_its_ring_focuses_on_the_lcd(fine, sigma_mm, folds_mm):
    limit = press_limit(fine, PressKind(Shape.GAUSSIAN, sigma_mm), X_MM, 0.0)
    # folds_mm: a ray tracer of its own; 3 % of search, 2 % of area left, the finite distance of nodes
    assert limit.fold_mm == pytest.approx(folds_mm, rel=0.07)
    middle = np.nanargmin(np.hypot(fine.x_mm - X_MM, fine.y_mm))
    even = gaussian_fold_mm(fine, sigma_mm).ravel()[middle]
    # the ring's far side, sqrt(3) sigma on, has a longer path; 5 % as above
    longer = 1 + np.sqrt(3) * sigma_mm * np.sin(np.radians(50.0)) / PATH_MM
    assert 0.95 * even / longer < limit.fold_mm < even


def test_drawing_ends_before_folding(fine):
    limit = press_limit(fine, PressKind(Shape.GAUSSIAN, 1.0), X_MM, 0.0)
    assert 0.0 < limit.nulled_mm < limit.fold_mm
    assert limit.because in {"too fine for the LCD", "fold"}


def test_total_reflection_ends_where_the_steepest_slope_eats_the_margin(fine):
    sigma_mm = 1.0
    limit = press_limit(fine, PressKind(Shape.GAUSSIAN, sigma_mm), X_MM, 0.0)
    margin = np.radians(50.0) - np.arcsin(1 / 1.41)
    # slopes of a Gaussian reach depth / sigma exp(-1/2)
    expected = np.tan(margin) * sigma_mm * np.exp(0.5)
    # found from below to 3 %, and nodes miss the very steepest point by less than 1 %
    assert 0.97 * expected < limit.total_mm < 1.01 * expected


def test_below_the_critical_angle_no_press_is_total():
    view = SampledView(telecentric(45.0))
    assert press_limit(view, PressKind(Shape.GAUSSIAN, 3.0), 42.0, 0.0).total_mm == 0.0


def test_a_place_that_is_not_seen_says_so(fine):
    limit = press_limit(fine, PressKind(Shape.GAUSSIAN, 1.0), X_MM + 30.0, 0.0)
    assert (limit.nulled_mm, limit.because) == (0.0, "not seen")


def test_a_target_finer_than_the_lcd_is_named():
    view = SampledView(telecentric(pixel_mm=0.03, target={"period_px": 8}))  # 3.8 LCD px per period
    limit = press_limit(view, PressKind(Shape.GAUSSIAN, 1.0), 38.0, 0.0)
    assert (limit.nulled_mm, limit.because) == (0.0, "too fine for the LCD at rest")


@pytest.mark.parametrize("text", ["gaussian", "gaussian:0", "gaussian:-1", "map:2", "ball:x", "cone:nan", ""])
def test_what_is_no_press_is_refused(text):
    with pytest.raises(InputError, match="--press"):
        PressKind.parse(text)


def test_a_press_reads_as_it_is_written():
    assert str(PressKind.parse("ball:12.5")) == "ball:12.5"


def test_between_the_places_the_map_is_what_the_rays_say():
    view = SampledView(telecentric(pixel_mm=0.1))
    kind = PressKind(Shape.GAUSSIAN, 3.0)
    known = [
        {"x_mm": x, "y_mm": 0.0, "nulled_mm": press_limit(view, kind, x, 0.0).nulled_mm} for x in (25.0, 50.0)
    ]
    found = nulled_mm(view, known)
    node = np.unravel_index(np.nanargmin(np.hypot(view.x_mm - 37.0, view.y_mm)), found.shape)
    exact = press_limit(view, kind, 37.0, 0.0).nulled_mm
    # 3 % of search on either
    assert found[node] == pytest.approx(exact, rel=0.06)
    # the nearest place's limit alone would be a quarter off
    assert abs(known[1]["nulled_mm"] / exact - 1) > 0.2
