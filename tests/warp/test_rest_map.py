"""The rest map as a file and as a measured warp."""

import numpy as np
import pytest
from decoding.planted import smooth_map

from zeromethod import InputError, NodeGrid
from zeromethod.decoding import Reason
from zeromethod.warp.rest_map import RestMap
from zeromethod.warp.validity import Flag

SHAPE = (256, 320)
GRID = NodeGrid(SHAPE, 16)


def noisy(sigma: float = 0.03) -> RestMap:
    lcd = smooth_map(SHAPE)
    rng = np.random.default_rng(2)
    return RestMap(
        lcd + sigma * rng.normal(size=lcd.shape),
        np.full(lcd.shape, sigma),
        np.ones(SHAPE, dtype=bool),
        np.zeros(SHAPE, dtype=np.uint16),
    )


def without(rest: RestMap, mask: np.ndarray, reason: Reason) -> RestMap:
    lcd, sigma = rest.lcd_px.copy(), rest.sigma_px.copy()
    lcd[mask], sigma[mask] = np.nan, np.nan
    return RestMap(lcd, sigma, rest.valid & ~mask, np.where(mask, int(reason), rest.reason).astype(np.uint16))


def true_nodes() -> np.ndarray:
    return smooth_map(SHAPE)[np.ix_(GRID.v_px[4:-4].astype(int), GRID.u_px[4:-4].astype(int))]


def test_nodes_of_the_warp_lie_on_the_map_within_sigma():
    warp = noisy().warp(GRID)
    assert warp.valid[GRID.inner].all()
    assert not warp.valid[:4].any()
    z = (warp.q[GRID.inner] - true_nodes()) / warp.sigma[GRID.inner]
    # 2,200 nodes and components know their spread to 1.5 %; the quadratic fits to a thousandth of a px.
    assert z.std() == pytest.approx(1.0, abs=0.05)
    # A quadratic through 9 x 9 pixels: in its middle 1 + 2 x 1.3 times the variance of the mean.
    assert np.median(warp.sigma[GRID.inner]) == pytest.approx(0.03 * np.sqrt(3.6 / 81), rel=0.03)


def test_a_few_lost_pixels_cost_no_node_and_many_do_by_name():
    rest = noisy()
    rng = np.random.default_rng(0)
    speckled = without(rest, rng.random(SHAPE) < 0.1, Reason.DEAD)
    assert speckled.warp(GRID).valid[GRID.inner].all()
    v, u = int(GRID.v_px[12]), int(GRID.u_px[15])
    mask = np.zeros(SHAPE, dtype=bool)
    mask[v - 12 : v + 13, u - 12 : u + 13] = True
    for reason, flag in (
        (Reason.NO_MODULATION, Flag.MODULATION),
        (Reason.SECOND_REFLECTION, Flag.MIXED),
        (Reason.DISTURBED, Flag.LIGHT_LOST),
        (Reason.WRONG_ORDER, Flag.AMBIGUOUS),
        (Reason.OFF_DISPLAY, Flag.OFF_DISPLAY),
    ):
        warp = without(rest, mask, reason).warp(GRID)
        assert warp.flags[12, 15] == int(flag)
        assert np.isnan(warp.q[12, 15]).all()
        assert warp.valid[12, 18]


def test_a_warp_of_another_camera_is_refused():
    with pytest.raises(InputError, match="320 x 256 px: the camera has 640 x 512"):
        noisy().warp(NodeGrid((512, 640), 16))


def test_saved_and_loaded_maps_are_the_same(tmp_path):
    rest = without(noisy(), np.eye(*SHAPE, dtype=bool), Reason.DEAD)
    rest.save(tmp_path / "rest.npz")
    again = RestMap.load(tmp_path / "rest.npz")
    for name in ("lcd_px", "sigma_px", "valid", "reason"):
        assert np.array_equal(getattr(again, name), getattr(rest, name), equal_nan=name.endswith("px"))
    assert [path.name for path in tmp_path.iterdir()] == ["rest.npz"]


@pytest.mark.parametrize("content", [b"", b"no archive", None])
def test_what_is_no_rest_map_is_refused_in_one_line(tmp_path, content):
    path = tmp_path / "rest.npz"
    if content is None:
        np.savez(path, column=np.zeros((3, 3)))
    else:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"rest\.npz: .*a rest map") as refused:
        RestMap.load(path)
    assert "\n" not in str(refused.value)


def test_a_missing_rest_map_is_refused(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        RestMap.load(tmp_path / "none.npz")
