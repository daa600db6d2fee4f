from dataclasses import replace

import numpy as np
import pytest
from surface_bench import Bench, Gauss, Load, Waves, small_rig

from zeromethod.errors import InputError
from zeromethod.rig.model import RestSurface
from zeromethod.simulation.loads import load
from zeromethod.simulation.press import Mirror
from zeromethod.surface import SurfaceReader, multigrid, peak, settling
from zeromethod.warp.validity import Flag


@pytest.mark.parametrize("nodes", [4, 6, 13])
def test_gain_is_one_for_narrow_dents(full, nodes):
    sigma = nodes * full.pitch_mm
    dent = Load(min(0.2, 0.008 * sigma**2), full.centre_mm + 0.11, 0.07, sigma)
    surface = full.reader.read(full.warp(dent))
    constant, shape = full.constant_and_shape(surface, dent)
    # issue: 1.000 +- 0.002; the sixth-order rule leaves 3e-5 at 4 nodes
    assert np.abs(shape).max() < 1e-4 * dent.depth_mm
    # bar 0.1 um
    assert abs(constant) < 1e-4
    assert peak(surface).depth_mm - constant == pytest.approx(dent.depth_mm, rel=2e-4)


@pytest.mark.parametrize("nodes", [20, 32, 64])
def test_gain_is_one_for_dents_that_fill_the_view(full, nodes):
    """Whatever the constant: slopes leave open one multiple of h."""
    dent = Load(0.02, full.centre_mm, 0.0, nodes * full.pitch_mm)
    surface = full.reader.read(full.warp(dent))
    # h is the linear part of what an offset does; the rest is second order: offset / distance to the LCD
    assert np.abs(full.constant_and_shape(surface, dent)[1]).max() < 2e-3 * dent.depth_mm


@pytest.mark.parametrize("nodes", [12, 24, 48])
def test_gain_is_one_at_every_wavelength(full, nodes):
    """Of waves that no rubber bears: whatever the constant."""
    wavelength = nodes * full.pitch_mm
    hull = Gauss(1.0, full.centre_mm, 0.0, 4.0)
    waves = Waves(0.001 * wavelength, full.centre_mm + 0.2, 0.3, wavelength, hull)
    surface = full.reader.read(full.warp(waves))
    truth = full.truth(waves)[surface.valid]
    gain = 1.0 + (full.constant_and_shape(surface, waves)[1] @ truth) / (truth @ truth)
    # 191/60480 w^6, w = 2 pi / 12 nodes on both axes: 7e-5
    assert gain == pytest.approx(1.0, abs=1.5e-4)


@pytest.mark.parametrize("dx", [-6.0, 0.0, 6.0])
def test_default_press_is_read_absolutely(full, dx):
    dent = Load(0.2, full.centre_mm + dx, 0.0, 5.0)
    surface = full.reader.read(full.warp(dent))
    constant, shape = full.constant_and_shape(surface, dent)
    assert np.abs(shape).max() < 1e-4 * 0.2
    # bar: constant within 0.1 um
    assert abs(constant) < 1e-4
    assert surface.iterations <= 5


def test_a_reader_without_sigma_reads_the_same_depths_from_the_same_loads(small):
    warp = small.warp(Load(0.2, small.centre_mm, 0.0, 5.0))
    whole, bare = (SurfaceReader(small.rig, small.optics, small.grid, x) for x in (True, False))
    surface = whole.read(warp)
    depths = bare.read(warp, None, whole.learned)
    # where the passes stop
    np.testing.assert_allclose(depths.depth_mm, surface.depth_mm, atol=1e-7)
    assert np.isnan(depths.sigma_depth_mm).all()
    assert np.isnan(peak(depths).sigma_mm)
    assert depths.curl is None


def test_slope_and_position_are_those_of_the_moved_point(full):
    dent = Load(0.2, full.centre_mm, 0.0, 5.0)
    surface = full.reader.read(full.warp(dent))
    v = surface.valid
    x, y = surface.x_mm[v], surface.y_mm[v]
    expected = np.stack(dent.slope(x, y), axis=-1)
    # a constant of 0.1 um, and 2 % of it per mm
    np.testing.assert_allclose(surface.slope[v], expected, atol=2e-6)
    np.testing.assert_allclose(surface.depth_mm[v], dent.depth(x, y), atol=1e-4)


def test_one_pass_is_not_enough(small, monkeypatch):
    dent = Load(0.2, small.centre_mm, 0.0, 5.0)
    warp = small.warp(dent)
    monkeypatch.setattr(settling, "_MOST_PASSES", 1)
    once = np.abs(small.error(small.reader.read(warp), dent)).max()
    monkeypatch.undo()
    settled = np.abs(small.error(small.reader.read(warp), dent)).max()
    assert once > 1e-3
    # 3.4 nodes of sigma on the binned lattice: 1.3e-4 of the peak from the rule
    assert settled < 5e-5


def tilted(folder):
    x, y = np.meshgrid(np.arange(-5.0, 85.0, 2.0), np.arange(-30.0, 31.0, 2.0))
    np.save(folder / "rest.npy", 0.004 * (x - 38.0) - 0.003 * y + 1e-5 * (x - 38.0) ** 2)
    return RestSurface(shape="map", file=folder / "rest.npy", pitch_mm=2.0, origin_mm=(-5.0, -30.0))


@pytest.mark.parametrize(
    ("shape", "radius"), [("sphere", 400.0), ("sphere", -600.0), ("cylinder", 300.0), ("map", None)]
)
def test_a_rest_surface_that_is_not_flat(shape, radius, tmp_path):
    curved = {"shape": shape, "radius_mm": radius, "centre_mm": (38.6, 0.0)}
    bench = Bench(small_rig(RestSurface(**curved) if radius else tilted(tmp_path)))
    dent = Load(0.2, bench.centre_mm, 0.0, 5.0)
    at_rest = bench.reader.read(bench.warp(replace(dent, depth_mm=0.0)))
    # nothing but rounding
    assert np.abs(at_rest.depth_mm[at_rest.valid]).max() < 1e-9
    surface = bench.reader.read(bench.warp(dent))
    assert np.count_nonzero(surface.valid) > 500
    # 3.4 nodes of sigma on the binned lattice
    assert np.abs(bench.error(surface, dent)).max() < 1e-4


@pytest.mark.parametrize(("beside_mm", "depth_mm"), [(40.0, 0.3), (40.0, 1.0), (30.0, 0.3)])
def test_a_wide_press_with_its_middle_out_of_view_is_not_said_to_be_known_well(small, beside_mm, depth_mm):
    """It is much like the multiple of the scale that moves nothing: its depth comes from laws alone."""
    dent = Load(depth_mm, 42.0 + beside_mm, 0.0, 40.0)
    found = peak(small.reader.read(small.warp(dent, np.random.default_rng(1))))
    error_mm = found.depth_mm - float(dent.depth(np.array(found.x_mm), np.array(found.y_mm)))
    assert abs(error_mm) < 3 * found.sigma_mm


def test_bulges_stay_negative(small):
    """A layer that keeps its volume rises around a press."""
    layer = {"rubber.support": "bonded", "rubber.thickness_mm": 8.0}
    bench = Bench(small_rig().replace(layer))
    press = Mirror((load(bench.centre_mm, 0.0, 0.2, 3.0, bench.rig.rubber),))
    surface = bench.reader.read(bench.warp(press))
    truth = bench.truth(press)
    lowest = np.nanargmin(np.where(surface.valid, truth, np.nan))
    assert truth.flat[lowest] < -8e-3
    assert surface.depth_mm.flat[lowest] == pytest.approx(truth.flat[lowest], abs=2e-4)


def test_contact_hole_is_masked_and_the_rest_read(full):
    dent = Load(0.2, full.centre_mm, 0.0, 5.0)
    warp = full.warp(dent)
    hole = full.truth(dent) > 0.15
    warp.flags[hole] |= np.uint16(Flag.LIGHT_LOST)
    warp.q[hole] = np.nan
    surface = full.reader.read(warp)
    np.testing.assert_array_equal(surface.contact, hole)
    assert np.isnan(surface.depth_mm[hole]).all()
    assert not surface.valid[hole].any()
    # cubic rules next to the hole
    assert np.abs(full.error(surface, dent)).max() < 1e-3 * 0.2


def test_padding_and_flagged_nodes_are_nan(small):
    warp = small.warp(Load(0.1, small.centre_mm, 0.0, 6.0))
    warp.flags[10, 12] |= np.uint16(Flag.MODULATION)
    surface = small.reader.read(warp)
    assert surface.time_ns == 7
    assert surface.depth_mm.shape == small.grid.shape
    assert surface.slope.shape == (*small.grid.shape, 2)
    assert not surface.valid[10, 12]
    read = surface.depth_mm, surface.sigma_depth_mm, surface.slope[..., 0], surface.sigma_slope[..., 1]
    for field in read:
        np.testing.assert_array_equal(np.isfinite(field), surface.valid)
    # the mirror points go on smoothly past the mirror, so that every plot takes them
    assert not surface.on_mirror.all()
    assert np.isfinite(surface.x_mm).all()
    assert np.isfinite(surface.y_mm).all()
    np.testing.assert_array_equal(np.isfinite(surface.points_mm).all(axis=-1), surface.on_mirror)
    assert not surface.valid[:4].any()


def test_nothing_valid_reads_as_nothing(small):
    warp = small.warp(Load(0.1, small.centre_mm, 0.0, 6.0))
    warp.flags[:] |= np.uint16(Flag.LIGHT_LOST)
    surface = small.reader.read(warp)
    assert not surface.valid.any()
    assert np.isnan(surface.depth_mm).all()
    assert surface.anchor.mode == "none"
    assert np.isnan(peak(surface).depth_mm)


def test_warp_of_another_grid_is_refused(small, full):
    with pytest.raises(InputError, match=r"warp\.q: shape"):
        small.reader.read(full.warp(Load(0.1, full.centre_mm, 0.0, 6.0)))


def test_a_part_of_the_view_is_read_as_well_as_all_of_it(small):
    """A dent in a few nodes that are lit, all else dark: of the planted shape."""
    row, col = (n // 2 for n in small.grid.shape)
    part = np.s_[row - 5 : row + 5, col - 5 : col + 5]
    rest = small.optics.trace(*small.grid.mesh(), small.optics.rest).point
    dent = Load(0.02, *rest[row, col, :2], 1.5 * small.pitch_mm)
    warp = small.warp(dent)
    flags = np.full_like(warp.flags, Flag.LIGHT_LOST)
    flags[part] = warp.flags[part]
    surface = SurfaceReader(small.rig, small.optics, small.grid).read(replace(warp, flags=flags))
    # what the border of ten nodes may be deep is in sigma; the shape is that of the planted dent
    assert np.ptp(small.constant_and_shape(surface, dent)[1]) < 0.02 * dent.depth_mm


def test_equations_that_are_not_solved_give_no_depth(small, monkeypatch):
    reader = SurfaceReader(small.rig, small.optics, small.grid)
    monkeypatch.setattr(multigrid, "_gradients", lambda *fields: fields[-1].fill(np.nan))
    assert not reader.read(small.warp(Load(0.02, small.centre_mm, 0.0, 5.0))).valid.any()
