"""A binned rig is the same bench with larger pixels."""

import pytest
from small_rigs import with_tables

from zeromethod import InputError, binned, load_rig


def view(name: str, factor: int) -> list[float]:
    """Tangents of the angles between the axis and the image's left, right, upper and lower edge."""
    camera = binned(load_rig(name), factor).camera
    assert camera.focal_px is not None
    (fx, fy), (cx, cy) = camera.focal_px, camera.centre_px
    # pixel centres are at integers, so the image reaches half a pixel further on every side
    right, bottom = camera.columns - 0.5, camera.rows - 0.5
    return [(-0.5 - cx) / fx, (right - cx) / fx, (-0.5 - cy) / fy, (bottom - cy) / fy]


@pytest.mark.parametrize("factor", [2, 4, 8])
def test_binning_keeps_the_view(factor):
    # rounding of a few float operations only
    assert view("simulated", factor) == pytest.approx(view("simulated", 1), rel=1e-12)


def test_binning_by_one_changes_nothing():
    for name in ("simulated", "paper"):
        assert binned(load_rig(name), 1) == load_rig(name)


def test_orthographic_pixels_grow():
    rig = load_rig("paper")
    camera = binned(with_tables(rig, camera={"columns": 624}), 2).camera
    assert (camera.columns, camera.rows) == (312, 196)
    assert camera.pixel_mm == 0.2
    # the outer edge of the first column, in mm from the pixel that looks along the axis
    assert (-0.5 - camera.centre_px[0]) * 0.2 == pytest.approx((-0.5 - 312.0) * 0.1, rel=1e-12)


@pytest.mark.parametrize("factor", [3, 0, -2, 2.0, True])
def test_factor_that_does_not_divide_is_refused(factor):
    with pytest.raises(InputError, match=r"a whole number that divides 1280 and 1024 camera px$"):
        binned(load_rig("simulated"), factor)


def test_factor_that_leaves_too_few_pixels_is_refused():
    with pytest.raises(InputError, match="binning: 32: one that leaves at least 64 camera px"):
        binned(load_rig("simulated"), 32)
