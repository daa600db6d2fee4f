"""A camera whose lens the rig does not know: the measured rest gives every node its ray back."""

import numpy as np
import pytest
from small_rigs import with_tables

from zeromethod import NodeGrid, Rig, SurfaceReader, Warp, binned, load_rig, peak
from zeromethod.optics import Dented, Optics
from zeromethod.simulation.loads import load
from zeromethod.simulation.press import Mirror
from zeromethod.warp.rest_pixels import RestGrid, rest_pixels
from zeromethod.warp.validity import Flag

PRESS = Mirror((load(37.0, 4.0, 0.2, 3.5),))


@pytest.fixture(scope="module")
def believed() -> Rig:
    return binned(load_rig("simulated"), 4)


@pytest.fixture(scope="module")
def true(believed):
    # 2 % at the corner, 0.09 of the focal length from the middle, and an optical centre off by some px
    changes = {"distortion": (2.4, 0.0, 1e-3, 0.0, 0.0), "centre_px": (163.0, 125.0)}
    return Optics(with_tables(believed, camera=changes))


@pytest.fixture(scope="module")
def grid(believed: Rig) -> NodeGrid:
    return NodeGrid.of_rig(believed)


def test_pixels_of_the_measured_rest_have_the_true_rays(believed, true, grid):
    ideal = Optics(believed)
    pixels = rest_pixels(ideal, np.stack(grid.mesh(), axis=-1), true.rest_map(*grid.mesh()))
    _, found = ideal.camera_rays(pixels[..., 0], pixels[..., 1])
    _, wanted = true.camera_rays(*grid.mesh())
    # Newton stops at 1e-9 px of 1 / 2250 rad
    assert np.max(np.abs((found - wanted)[grid.inner])) < 1e-11


def test_an_unknown_rest_leaves_the_pixel(believed, true, grid):
    q_rest = true.rest_map(*grid.mesh())
    q_rest[5, 7] = np.nan
    u, v = RestGrid.of(grid, Optics(believed), q_rest).mesh()
    assert (u[5, 7], v[5, 7]) == (grid.u_px[7], grid.v_px[5])
    assert u[5, 8] != grid.u_px[8]


def test_a_reader_on_them_reads_what_a_reader_that_knows_the_lens_reads(believed, true, grid):
    flags = np.where(grid.measurable, 0, Flag.OUTSIDE).astype(np.uint16)
    q = true.trace(*grid.mesh(), Dented(true.rest, PRESS)).q
    warp = Warp(q, np.full(q.shape, 0.01), flags, 0)
    ideal = Optics(believed)
    known = SurfaceReader(true.rig, true, grid).read(warp)
    found = SurfaceReader(believed, ideal, RestGrid.of(grid, ideal, true.rest_map(*grid.mesh()))).read(warp)
    # the same rays by another route: what is left is where the passes stop, 1e-7 mm
    assert np.nanmax(np.abs(found.depth_mm - known.depth_mm)) < 1e-6
    assert peak(found).x_mm == pytest.approx(peak(known).x_mm, abs=1e-4)
