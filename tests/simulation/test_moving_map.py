"""A mirror that moves from map to map."""

import numpy as np
import pytest

from zeromethod.optics import Dented, Optics
from zeromethod.simulation.camera import exposure_pieces
from zeromethod.simulation.gpu import GpuRenderer
from zeromethod.simulation.moving_map import BEND_MM, STILL_MM, MapPlacement, MovingMap
from zeromethod.simulation.numpy_renderer import NumpyRenderer
from zeromethod.simulation.panel import Presentation, SimulatedPanel
from zeromethod.simulation.press import Mirror
from zeromethod.simulation.scattered import ScatteredMap
from zeromethod.simulation.scenario import Scenario

MS = 1_000_000
LATTICE = MapPlacement((40.0, 0.0), 1.0)
PLACE = np.array([40.0]), np.array([0.5])


def bump(height_mm: float) -> np.ndarray:
    v, u = np.mgrid[-1:1:24j, -1:1:30j]
    return height_mm * (1 - u**2) ** 4 * (1 - v**2) ** 4


def moving(times_ms: list[int], heights_mm: list[float]) -> MovingMap:
    maps = [bump(height) for height in heights_mm]
    return MovingMap(LATTICE, [time * MS for time in times_ms], lambda index: maps[index])


def depth_at(press: MovingMap, time_ms: float) -> float:
    dent = press.dent_at(round(time_ms * MS))
    assert dent is not None
    return float(Mirror((dent,)).depth(*PLACE)[0])


def test_depth_goes_straight_from_map_to_map_and_stands_still_beyond_them():
    press = moving([10, 20, 40], [0.0, 0.1, 0.3])
    whole = depth_at(press, 20)
    assert depth_at(press, 15) == pytest.approx(0.5 * whole)
    assert depth_at(press, 30) == pytest.approx(2.0 * whole)
    assert depth_at(press, 0) == depth_at(press, 10) == 0.0
    assert depth_at(press, 90) == depth_at(press, 40) == pytest.approx(3.0 * whole)


def test_the_same_instant_is_the_same_mirror_so_that_it_is_traced_once():
    press = moving([10, 20], [0.0, 0.1])
    assert press.dent_at(12 * MS) is press.dent_at(12 * MS)
    assert press.dent_at(30 * MS) is press.dent_at(40 * MS)


def test_an_exposure_is_cut_only_where_the_velocity_jumps_visibly():
    press = moving([0, 10, 20, 30], [0.0, 0.0, 0.1, 0.2])
    assert press.bends_ns(0, 40 * MS) == (10 * MS, 30 * MS)
    assert press.bends_ns(10 * MS, 30 * MS) == ()  # at its borders it needs no cut
    assert moving([0, 10, 20], [0.0, 0.4 * BEND_MM, 0.0]).bends_ns(0, 20 * MS) == ()


def test_a_motion_that_no_frame_shows_is_none():
    assert not moving([0, 10], [0.0, 0.5 * STILL_MM]).moving(0, 10 * MS)
    press = moving([0, 10, 20], [0.0, 0.1, 0.1])
    assert press.moving(4 * MS, 12 * MS)
    assert not press.moving(10 * MS, 18 * MS)
    assert not press.moving(30 * MS, 40 * MS)


def test_a_mirror_without_maps_is_at_rest():
    press = MovingMap(LATTICE, [], lambda index: bump(0.1))
    assert press.dent_at(0) is None
    assert not press.moving(0, 10)


def test_the_pieces_of_an_exposure_average_to_the_motion_in_it(make_rig):
    scenario = Scenario("recorded", (moving([0, 10, 20], [0.0, 0.1, 0.0]),), 0.02)
    pieces = exposure_pieces(
        scenario, SimulatedPanel(make_rig().display, 60.0), [Presentation(-200 * MS, 1)], 6 * MS, 16 * MS
    )
    depth = sum(piece.weight * float(piece.mirror.depth(*PLACE)[0]) for piece in pieces)
    whole = depth_at(moving([0], [0.1]), 0)
    # from 0.6 up to 1 in 4 ms and down to 0.4 in 6 ms: mean 0.4 * 0.8 + 0.6 * 0.7
    assert depth == pytest.approx(0.74 * whole, rel=1e-6)


def test_both_renderers_see_it_as_the_exact_rays_do(make_rig):
    rig = make_rig()
    v, u = np.mgrid[0 : rig.camera.rows, 0 : rig.camera.columns].astype(np.float64)
    optics = Optics(rig)
    point = optics.trace(u, v, optics.rest).point.reshape(-1, 3)
    point = point[np.isfinite(point).all(axis=1)]
    fit = ScatteredMap(point[:, 0], point[:, 1], 1.0)
    depth_mm = 0.1 * np.exp(-((point[:, 0] - 40) ** 2 + point[:, 1] ** 2) / 50)
    maps = [fit.fit(point[:, 0], point[:, 1], share * depth_mm) for share in (0.5, 1.0)]
    press = MovingMap(MapPlacement(fit.centre_mm, fit.pitch_mm), [0, 10 * MS], lambda index: maps[index])
    mirror = Scenario("recorded", (press,), 0.01).mirror_at(4 * MS)
    exact = optics.trace(u, v, Dented(optics.rest, mirror)).q
    gpu = GpuRenderer(rig)
    by_gpu = gpu.ray_map(mirror)[0]
    gpu.close()
    by_numpy = NumpyRenderer(rig).ray_map(mirror)[0]
    arrives = np.isfinite(exact).all(axis=-1)
    assert arrives.mean() > 0.8
    # both trace in single precision at the end: as in the tests of the rays
    assert np.abs(by_gpu - exact)[arrives].max() < 0.005
    assert np.abs(by_numpy - exact)[arrives].max() < 0.005
