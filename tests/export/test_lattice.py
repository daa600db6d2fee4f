"""Resampling to a lattice in mm, against closed forms on nodes that are no lattice in mm."""

import numpy as np
import pytest

from zeromethod.export.lattice import MapLattice, Resampler

WIDTH_MM = 6.0


def view(turned: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Nodes as a tilted camera has them: 0.9 to 1.7 mm apart, fanning out; x falls where turned is -1."""
    col, row = np.meshgrid(np.arange(45.0), np.arange(31.0))
    depth = 1.0 + 0.012 * col
    return turned * (10.0 + 1.2 * col * np.sqrt(depth)), (row - 15.0) * 0.9 * depth


def dent(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.exp(-0.5 * ((np.abs(x) - 40.0) ** 2 + (y - 2.0) ** 2) / WIDTH_MM**2)


@pytest.mark.parametrize("turned", [1, -1])
def test_a_dent_comes_out_where_it_is_and_as_deep(turned):
    x, y = view(turned)
    lattice = MapLattice.covering(x, y, 0.5)
    known = np.ones(x.shape, bool)
    fields = np.stack([dent(x, y), 3.0 * x + y, y], axis=-1)
    found = Resampler(lattice)(x, y, known, fields)
    at_x, at_y = lattice.mesh()
    inside = np.isfinite(found[..., 0])
    # The cubic leaves 0.2 % of a dent as wide as 3 node distances, 0.07 % at 4; here it is 3.5 and more.
    assert np.abs(found[..., 0] - dent(at_x, at_y))[inside].max() < 2e-3
    # Places are found to the Newton steps' end, and planes are reproduced as well as places.
    assert found[..., 1][inside] == pytest.approx((3.0 * at_x + at_y)[inside], abs=1e-3)
    assert inside.mean() > 0.7


def test_nothing_is_given_beyond_the_nodes_or_next_to_an_invalid_one():
    x, y = view()
    known = np.ones(x.shape, bool)
    known[10, 20] = False
    lattice = MapLattice.covering(x, y, 0.25)
    found = Resampler(lattice)(x, y, known, np.where(known, dent(x, y), np.nan)[..., None])[..., 0]
    at_x, at_y = lattice.mesh()
    hole = np.hypot(at_x - x[10, 20], at_y - y[10, 20])
    assert np.isnan(found[hole < 0.8]).all()
    beyond = np.abs(at_y) > 15 * 0.9 * (1.0 + 0.012 * 44) - 0.01
    assert np.isnan(found[beyond]).all()
    assert np.isfinite(found[(np.abs(at_y) < 10) & (hole > 3.0) & (at_x > 11) & (at_x < 70)]).all()


def test_a_second_map_of_moved_nodes_needs_no_new_start():
    x, y = view()
    lattice = MapLattice.covering(x, y, 0.5)
    resampled = Resampler(lattice)
    known = np.ones(x.shape, bool)
    resampled(x, y, known, dent(x, y)[..., None])
    moved = x + 0.3 * dent(x, y)
    again = resampled(moved, y, known, dent(moved, y)[..., None])[..., 0]
    fresh = Resampler(lattice)(moved, y, known, dent(moved, y)[..., None])[..., 0]
    both = np.isfinite(again) & np.isfinite(fresh)
    # Newton ends below 1e-6 nodes from either start.
    assert again[both] == pytest.approx(fresh[both], abs=1e-6)
    assert both.sum() > 0.99 * np.isfinite(fresh).sum()


def test_the_pitch_is_the_finer_of_the_nodes_own_and_the_origin_a_multiple():
    x, y = view()
    lattice = MapLattice.covering(x, y)
    finer = min(np.median(np.hypot(np.diff(x, axis=a), np.diff(y, axis=a))) for a in (0, 1))
    assert 0.9 * finer < lattice.pitch_mm <= finer
    assert lattice.pitch_mm == pytest.approx(round(lattice.pitch_mm, 2), abs=1e-12)
    steps = np.array([lattice.x0_mm, lattice.y0_mm]) / lattice.pitch_mm
    assert steps == pytest.approx(np.rint(steps), abs=1e-9)
