"""A dent too fine and steep for the LCD, read by coded pictures while the rest of the view stays nulled."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from benchmarks.rigs import VIEW_MIDDLE_MM, changed, opened, pressed, small_rig
from zeromethod import Recording, Session, State, load_rig, open_devices
from zeromethod.loop.burst import Burst, Read
from zeromethod.loop.events import Event
from zeromethod.loop.failing_nodes import joined_to
from zeromethod.optics import Dented, Optics
from zeromethod.pattern.coded import PICTURES
from zeromethod.session.replay.from_frames import replay_from_frames
from zeromethod.session.replay.window import Window
from zeromethod.warp.rest import Rest
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

PRESS_S, FRAMES = 0.1, 110
DEPTH_MM, SIZE_MM = 0.05, 1.0


def middle_of_the_view():
    """The packaged bench with the middle of its camera alone: the dent has room in it."""
    camera = {"columns": 400, "rows": 320, "centre_px": (199.5, 159.5)}
    return changed(load_rig("simulated"), camera=camera)


def steep(**control: object):
    """A bench under a dent that folds, from `PRESS_S` on."""
    rig = changed(middle_of_the_view(), control=control)
    path = [(PRESS_S, 0.0), (PRESS_S, DEPTH_MM), (2.0, DEPTH_MM)]
    return pressed(rig, path, SIZE_MM, (VIEW_MIDDLE_MM, 0.0))


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """Where the run is recorded."""
    return tmp_path_factory.mktemp("burst") / "burst.h5"


@pytest.fixture(scope="module")
def bench(file):
    """Steps of a run; how far the pixels that its burst read truly are from there, LCD px."""
    with steep() as rig, open_devices(rig) as devices, Session(rig, devices=devices, record=file) as session:
        steps = list(session.run(frames=FRAMES))
        read, mirror = session.loop.burst_read, devices.camera.truth(steps[-1].time_ns)
        v, u = np.mgrid[: read.known.shape[0], : read.known.shape[1]].astype(float)
        optics = Optics(rig)
        true_q = optics.trace(u + read.left, v + read.top, Dented(optics.rest, mirror)).q
    return steps, np.abs(read.places - true_q).max(axis=-1)[read.known]


@pytest.fixture(scope="module")
def run(bench):
    """Steps of a run."""
    return bench[0]


def test_a_dent_that_folds_is_read_within_a_percent_and_the_loop_locks(run):
    last = run[-1]
    assert last.state is State.LOCKED
    assert last.valid_share > 0.999
    assert abs(last.peak.depth_mm / DEPTH_MM - 1) < 0.01
    assert abs(last.peak.depth_mm - DEPTH_MM) < 3 * last.peak.sigma_mm


def test_the_rest_stays_nulled_during_the_burst(run):
    burst = [step.residual_rms_px for step in run if Event.BURST in step.events]
    before = [step.residual_rms_px for step in run if step.state is State.RESTING]
    # two or three frames for each picture, so that one exposure sees it alone
    assert 2 * PICTURES <= len(burst) <= 4 * PICTURES
    assert np.median(burst) < 1.1 * np.median(before)


def test_no_pixel_is_read_a_whole_lcd_pixel_off(bench):
    """Those that look at the end of the fringes, and at the picture beside them, would be: 1.2 px."""
    assert len(bench[1]) > 40_000
    assert bench[1].max() < 1.0


def test_a_node_beside_what_was_read_counts_by_it_only_where_it_fails():
    rig = small_rig()
    rest = Rest.of(rig, Optics(rig))
    nodes = {name: np.zeros(rest.flags.shape, np.bool_) for name in ("mask", "spare", "region", "ring")}
    nodes["mask"][15:20, 15:20] = nodes["spare"][15:20, 20:22] = nodes["ring"][8:10, 12:26] = True
    burst = Burst(rest, 0.0, always=False)
    pixels = {"places": np.zeros((1, 1, 2)), "known": np.zeros((1, 1), np.bool_), "top": 0, "left": 0}
    read = rest.q + 1.0, np.full_like(rest.q, 0.02)
    burst.read = Read(*read, **nodes, ring_q=rest.q, **pixels, time_ns=0)
    warp = Warp(rest.q.copy(), np.full_like(rest.q, 0.01), np.zeros_like(rest.flags), 1)
    warp.flags[nodes["mask"]] = np.uint16(Flag.FOLDED)
    warp.flags[15:20, 15:17] = 0
    warp.q[15:20, 15:17] += 1.0
    warp.flags[16, 20] = np.uint16(Flag.LIGHT_LOST)
    merged = burst.merge(warp)
    assert np.array_equal(np.argwhere(merged & ~nodes["mask"]), [[16, 20]])
    assert np.allclose(warp.q[16, 20], rest.q[16, 20] + 1.0)
    assert np.allclose(warp.q[17, 20], rest.q[17, 20])
    assert warp.valid[16, 20]


def test_meanwhile_nothing_is_called_known_that_is_not(run):
    pressed_ns = run[0].time_ns + 1e9 * (PRESS_S + 1 / 60)
    waited = [step for step in run if step.time_ns > pressed_ns]
    # nor while the burst waits for the mirror to be at rest
    began = next(k for k, step in enumerate(waited) if Event.BURST in step.events)
    assert not any(step.state in {State.LOCKED, State.RESTING} for step in waited[:began])
    for step in waited:
        if step.peak is not None and step.state in {State.LOCKED, State.RESTING}:
            assert abs(step.peak.depth_mm - DEPTH_MM) < 3 * step.peak.sigma_mm
    during = next(step for step in run if Event.BURST in step.events)
    assert np.any(during.measured.flags & np.uint16(Flag.CODED))
    # coded pictures are no contact, though their carrier is gone
    assert not any(step.contacts for step in run)


def test_when_the_press_lifts_what_was_read_is_over():
    path = [(PRESS_S, 0.0), (PRESS_S, DEPTH_MM), (1.7, DEPTH_MM), (1.7, 0.0)]
    with pressed(middle_of_the_view(), path, SIZE_MM) as rig, opened(rig) as bench:
        states = [step.state for step in bench.loop.run(frames=118)]
        assert bench.loop.burst_read is None
    assert State.LOCKED in states[80:102]
    assert State.RESTING in states[102:114]


def test_a_burst_breaks_off_where_the_mirror_moves():
    path = [(PRESS_S, 0.0), (PRESS_S, DEPTH_MM), (0.8, DEPTH_MM), (1.5, 2 * DEPTH_MM)]
    with pressed(middle_of_the_view(), path, SIZE_MM) as rig, opened(rig) as bench:
        coded = [Event.BURST in step.events for step in bench.loop.run(frames=80)]
    assert any(coded[36:46])
    assert not any(coded[70:])


def test_never_means_never():
    with steep(burst="never") as rig, opened(rig) as bench:
        assert not any(Event.BURST in step.events for step in bench.loop.run(frames=60))


def test_always_begins_another_one():
    with steep(burst="always") as rig, opened(rig) as bench:
        coded = [Event.BURST in step.events for step in bench.loop.run(frames=160)]
    begins = sum(now and not before for before, now in pairwise(coded))
    assert begins >= 2


def test_a_recording_of_a_burst_replays_bit_for_bit(run, file):
    with Recording(file) as recording:
        warps, depths, _ = replay_from_frames(recording, recording.rig, Window.of(recording))
    assert warps.different == depths.different == []
    assert warps.steps > 2 * PICTURES


def test_coded_pictures_are_numbered_in_the_order_in_which_they_are_drawn(run):
    drawn = [one.coded for step in run for one in step.presented]
    numbers = [one for one in drawn if one is not None]
    assert sorted(set(numbers)) == list(range(PICTURES))
    assert numbers == sorted(numbers)


def test_what_the_edge_of_a_light_cuts_off_is_read_with_the_nodes_beyond_the_edge():
    """Places are told by what they are continuous with: alone, the piece would never be read."""
    cut_off, edge = np.zeros((2, 30, 60), np.bool_)
    cut_off[:, 54:], edge[:, 49:54] = True, True
    known = ~cut_off & ~edge
    measurable = np.ones_like(known)
    assert (joined_to(known, cut_off, measurable) & known).any()
    alone = np.zeros_like(known)
    alone[10:14, 20:24] = True
    assert np.count_nonzero(joined_to(~alone, alone, measurable)) == 10**2  # three nodes around and no more
