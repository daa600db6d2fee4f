"""The warp at rest: by the geometry, or as a rest map measured it, with its rays."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_rigs import with_tables

from zeromethod import InputError, NodeGrid, Rig, SurfaceReader, Warp, binned, peak
from zeromethod.calibration import build, describe
from zeromethod.optics import Dented, Optics
from zeromethod.rig.load import load_rig, parse_rig
from zeromethod.rig.save import save_values
from zeromethod.simulation.loads import load
from zeromethod.simulation.press import Mirror
from zeromethod.warp.rest import Rest
from zeromethod.warp.rest_map import Reason, RestMap
from zeromethod.warp.rest_pixels import RestGrid

NOISE_PX = 0.03
DEPTH_MM = 0.2


@pytest.fixture(scope="module")
def believed() -> Rig:
    return binned(load_rig("simulated"), 4)


@pytest.fixture(scope="module")
def bench(believed: Rig) -> Optics:
    """What the rig file does not know: a lens with 0.4 camera px of distortion, and a shifted LCD."""
    across_mm = describe(believed)["display.across_mm"] + 0.5
    return Optics(build(believed, {"camera.k1": 0.3, "display.across_mm": across_mm}))


@pytest.fixture(scope="module")
def rest_map(bench: Optics) -> RestMap:
    camera = bench.rig.camera
    v, u = np.indices((camera.rows, camera.columns), dtype=np.float64)
    lcd = bench.rest_map(u, v) + NOISE_PX * np.random.default_rng(1).standard_normal((*u.shape, 2))
    valid = np.isfinite(lcd).all(axis=-1)
    return RestMap(lcd, np.full(lcd.shape, NOISE_PX), valid, np.zeros(valid.shape, np.uint16))


def with_map(rig: Rig, rest_map: RestMap, path: Path) -> tuple[Rig, Rest]:
    """The rig with a rest map, and its warp at rest."""
    rest_map.save(path)
    rig = with_tables(rig, camera={"rest_map": path})
    return rig, Rest.of(rig, Optics(rig))


def test_the_measured_rest_is_the_rest_of_the_loop(believed, bench, rest_map, tmp_path):
    _, rest = with_map(believed, rest_map, tmp_path / "rest.npz")
    by_geometry = Rest.of(believed, Optics(believed))
    truth = bench.rest_map(*by_geometry.grid.mesh())
    visible = rest.visible
    assert visible.sum() > 0.95 * by_geometry.visible.sum()
    # the quadratic of a node's window of 9 x 9 px takes the noise down to a quarter
    np.testing.assert_allclose(rest.q[visible], truth[visible], atol=4 * NOISE_PX / 4)
    assert np.abs(by_geometry.q[visible] - truth[visible]).max() > 1.0


def test_a_press_is_read_on_the_rays_that_the_measured_rest_names(believed, bench, rest_map, tmp_path):
    rig, rest = with_map(believed, rest_map, tmp_path / "rest.npz")
    pixels = NodeGrid(rest.grid.image_shape, rest.grid.period_px).mesh()
    x, y, _ = np.median(bench.trace(*pixels, bench.rest).point[rest.visible], axis=0).tolist()
    mirror = Mirror((load(x, y, DEPTH_MM, 3.5),))
    q = bench.trace(*pixels, Dented(bench.rest, mirror)).q
    flags = np.where(rest.visible, 0, 1).astype(np.uint16)
    warp = Warp(q, np.full(q.shape, NOISE_PX / 4), flags, 0)
    assert isinstance(rest.grid, RestGrid)
    found = peak(SurfaceReader(rig, Optics(rig), rest.grid).read(warp))
    # what is left: the LCD's half millimetre across, which costs no depth, and noise of 0.1 %
    assert found.depth_mm == pytest.approx(DEPTH_MM, rel=3e-3)


def test_nodes_that_the_rest_map_leaves_out_are_drawn_and_not_visible(believed, bench, rest_map, tmp_path):
    valid, reason, lcd = rest_map.valid.copy(), rest_map.reason.copy(), rest_map.lcd_px.copy()
    hole = slice(100, 140), slice(120, 180)
    valid[hole], reason[hole], lcd[hole] = False, int(Reason.SECOND_REFLECTION), np.nan
    holed = replace(rest_map, lcd_px=lcd, valid=valid, reason=reason)
    _, rest = with_map(believed, holed, tmp_path / "rest.npz")
    u, v = np.meshgrid(rest.grid.u_px, rest.grid.v_px)
    inside = (v > 104) & (v < 136) & (u > 124) & (u < 176)
    assert not rest.visible[inside].any()
    # continued from around: the lens bends by less than a pixel over the hole
    np.testing.assert_allclose(rest.q[inside], bench.rest_map(u, v)[inside], atol=0.2)


def test_a_rest_map_of_another_camera_is_refused(believed, rest_map, tmp_path):
    with pytest.raises(InputError, match=r"320 x 256 px: the camera has 1280 x 1024"):
        with_map(load_rig("simulated"), rest_map, tmp_path / "rest.npz")


def test_a_rest_map_lies_next_to_its_rig_file(rest_map, tmp_path):
    source = tmp_path / "mine.toml"
    source.write_text(Path("calibration/rigs/simulated.toml").read_text())
    with pytest.raises(InputError, match=r"camera.rest_map: .rest.npz.: an existing .npz or .h5 file"):
        save_values(source, {"camera.rest_map": "rest.npz"})
    rest_map.save(tmp_path / "rest.npz")
    save_values(source, {"camera.rest_map": "rest.npz"})
    assert parse_rig(source.read_text(), source).camera.rest_map == tmp_path / "rest.npz"


def test_no_node_is_read_by_the_ray_of_another(tmp_path):
    """The paper's view ends at P0: a camera 0.15 mm further in than the rig file says has rays of its own."""
    rig = load_rig("paper")
    at = {
        f"camera.{key}": np.add(getattr(rig.camera, key), (0.15, 0, 0))
        for key in ("position_mm", "look_at_mm")
    }
    v, u = np.indices((rig.camera.rows, rig.camera.columns), dtype=np.float64)
    lcd = Optics(rig.replace({key: place.tolist() for key, place in at.items()})).rest_map(u, v)
    valid = np.isfinite(lcd).all(axis=-1)
    known = RestMap(lcd, np.full(lcd.shape, NOISE_PX), valid, np.zeros(valid.shape, np.uint16))
    rig, rest = with_map(rig, known, tmp_path / "rest.npz")
    seen = Optics(rig).rest_map(*rest.grid.mesh())
    # rays settle within 1e-6; those of the rig file see up to 2.4 LCD px beside
    np.testing.assert_allclose(seen[rest.visible], rest.q[rest.visible], atol=1e-5)
    assert rest.visible.sum() > 0.98 * Rest.of(load_rig("paper"), Optics(load_rig("paper"))).visible.sum()
