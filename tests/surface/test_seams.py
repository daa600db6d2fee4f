"""One surface over a saw's teeth, read from exact warps: nodes at seams are carried across, without steps."""

import numpy as np
import pytest
from surface_bench import Bench

from benchmarks.dents import Planted, dry_ball
from zeromethod import load_rig
from zeromethod.simulation.loads import load
from zeromethod.simulation.press import Mirror
from zeromethod.surface import peak
from zeromethod.warp.validity import Flag

RIG = load_rig("thin").replace({"camera.rows": 512, "camera.centre_px": (511.5, 255.5)})
"""Fewer rows than the packaged rig, as all rows are alike."""


def pressed(depth_mm, x_mm, y_mm, sigma_mm):
    """The rig's layer of rubber under a load: as curved in its middle as a Gaussian of this sigma."""
    return Mirror((load(x_mm, y_mm, depth_mm, sigma_mm / np.sqrt(2), RIG.rubber),))


@pytest.fixture(scope="module")
def thin():
    return Bench(RIG)


def seam_mm(bench) -> float:
    """Middle of a seam, by the nodes that it takes, mm."""
    surface = bench.reader.read(bench.warp(pressed(1e-4, 41.0, 0.0, 2.0)))
    row = surface.depth_mm.shape[0] // 2
    taken = np.flatnonzero(surface.seam[row])
    first = taken[np.flatnonzero(np.diff(taken) > 1)[0] + 1 :]
    run = first[: np.flatnonzero(np.diff(first) > 1)[0] + 1]
    return float(surface.x_mm[row, run].mean())


@pytest.mark.parametrize(("sigma_mm", "depth_mm"), [(1.5, 0.015), (2.0, 0.03), (3.0, 0.07)])
@pytest.mark.parametrize("off_mm", [0.0, 1.2, 4.1])
def test_a_dent_on_or_beside_a_seam_is_read_as_deep_as_it_is(thin, sigma_mm, depth_mm, off_mm):
    dent = pressed(depth_mm, seam_mm(thin) + off_mm, 0.07, sigma_mm)
    surface = thin.reader.read(thin.warp(dent))
    error = surface.depth_mm - dent.depth(surface.x_mm, surface.y_mm)
    assert np.abs(error[surface.valid]).max() < 5e-3 * depth_mm  # the bar of a known geometry
    assert peak(surface).depth_mm == pytest.approx(depth_mm, rel=2e-3)
    # what is carried knows that it may be off
    assert (np.abs(error) / surface.sigma_depth_mm)[surface.valid & surface.seam].max() < 4.0


@pytest.mark.parametrize("off_mm", [0.15, 0.65, 1.4])
def test_a_summit_on_a_seam_is_where_the_mirror_has_it(thin, off_mm):
    at_mm = seam_mm(thin) + off_mm
    dent = pressed(0.1, at_mm, 0.07, 5.0)
    found = peak(thin.reader.read(thin.warp(dent)))
    # nodes are not evenly apart there: a quartic over their numbers, not places, is up to 60 nm off; of the
    # constant 8 are
    assert abs(found.depth_mm - 0.1) < 2e-5
    assert abs(found.x_mm - at_mm) < 0.01


@pytest.mark.parametrize(("depth_mm", "sigma_mm"), [(0.02, 5.0), (0.25, 8.0)])
def test_no_step_is_left_across_a_seam(thin, depth_mm, sigma_mm):
    at = seam_mm(thin)
    dent = pressed(depth_mm, at + 6.0, 0.0, sigma_mm)
    surface = thin.reader.read(thin.warp(dent))
    error = surface.depth_mm - dent.depth(surface.x_mm, surface.y_mm)
    left, right = (
        (np.abs(surface.x_mm - at - way) < 0.5) & surface.valid & ~surface.seam for way in (-1.5, 1.5)
    )
    assert left.any()
    assert right.any()
    assert abs(np.median(error[right]) - np.median(error[left])) < 50e-6


def test_nodes_at_seams_are_not_believed(thin):
    dent = pressed(0.03, 40.0, 0.0, 2.0)
    warp = thin.warp(dent)
    warp.flags[thin.reader.read(warp).seam] |= np.uint16(Flag.SEAM)
    surface = thin.reader.read(warp)
    warp.q[surface.seam] += 7.0
    again = thin.reader.read(warp)
    np.testing.assert_allclose(
        again.depth_mm[surface.valid], surface.depth_mm[surface.valid], atol=1e-7, rtol=0
    )


def test_a_seam_beside_something_larger_that_is_lost_stays_open(thin):
    warp = thin.warp(pressed(0.01, 40.0, 0.0, 3.0))
    surface = thin.reader.read(warp)
    row = surface.depth_mm.shape[0] // 2
    ends = np.flatnonzero(np.diff(surface.seam[row].astype(int)) == -1)[1] + 1
    warp.flags[row, ends : ends + 8] |= np.uint16(Flag.LIGHT_LOST)
    assert not thin.reader.read(warp).valid[row, ends - 1]


@pytest.mark.parametrize("off_mm", [-1.0, 0.5])
def test_a_balls_rim_that_a_seam_hides_is_in_sigma(off_mm):
    # slope bends at the rim within less than a node: what is carried across rounds that off; Hertz's is deep
    deep = Bench(RIG.replace({"rubber.support": "free", "rubber.thickness_mm": None}))
    at = seam_mm(deep)
    ball = Planted(dry_ball, 0.05, at + 7.0 + off_mm, 0.0, 7.0)
    warp = deep.warp(ball)
    before = deep.reader.read(warp)
    # one side of the rim is tied to the other by the seam's nodes in a few rows alone
    beside = (np.abs(before.x_mm - at) < 1.5) & (np.abs(before.y_mm) > 1.0)
    warp.flags[beside] |= np.uint16(Flag.LIGHT_LOST)
    surface = deep.reader.read(warp)
    error = surface.depth_mm - ball.depth(surface.x_mm, surface.y_mm)
    tied = surface.valid & (surface.x_mm > at + 1.5)
    assert np.abs(error[tied]).max() > 2e-4  # 0.4 % of the depth: else it would not matter
    assert (np.abs(error) / surface.sigma_depth_mm)[tied].max() < 3.0  # as one row's noise alone it is 8


def test_a_tooth_that_is_not_as_the_rig_file_says_is_named_at_rest_and_under_a_press():
    off = tuple(0.05 if tooth == 5 else 0.0 for tooth in range(10))
    for true, name in ((RIG, ""), (RIG.replace({"prism.teeth.camera_deviation_deg": off}), "tooth 5's face")):
        bench, stands = Bench(RIG), Bench(true)
        for dent in (pressed(1e-6, 41.0, 0.0, 6.0), pressed(0.1, 41.0, 0.0, 6.0)):
            surface = bench.reader.read(stands.warp(dent, np.random.default_rng(3)))
            assert surface.curl.teeth.startswith(name)
            assert bool(surface.curl.teeth) is bool(name)
            error = surface.depth_mm - dent.depth(surface.x_mm, surface.y_mm)
            # 1 to 2 um, 40 sigma of noise: what is common to a frame is in sigma of each node
            assert np.quantile(np.abs(error / surface.sigma_depth_mm)[surface.valid], 0.97) < 3.0
