"""Which of the nodes that fail coded pictures could read."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.rigs import small_rig
from zeromethod.loop.failing_nodes import DIRTY_FRAMES, EDGE_NODES, FailingNodes
from zeromethod.optics import Optics
from zeromethod.warp.rest import Rest
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

LCD_PX_PER_NODE = 3.0
"""By which neighbours look further apart on a bent mirror: enough for a fold."""


@pytest.fixture(scope="module")
def rest():
    rig = small_rig()
    return Rest.of(rig, Optics(rig))


class Bench:
    """A patch of nodes in the middle of the view that may fail, on a bent mirror or a flat one."""

    def __init__(self, rest: Rest, bent: bool = True, dark: tuple[int, ...] = ()) -> None:
        """dark: rows of the patch, from its first, without light at rest."""
        self.rest = rest
        self.rows, self.cols = np.mgrid[0:4, 0:4] + np.array(rest.flags.shape)[:, None, None] // 2
        self.q = rest.q.copy()
        if bent:
            rows, cols = np.mgrid[-4:8, -4:8] + np.array(rest.flags.shape)[:, None, None] // 2
            self.q[rows, cols] += LCD_PX_PER_NODE * (cols - cols[0, 0])[..., None]
        flags = np.zeros_like(rest.flags)
        flags[self.rows[0, 0] + np.array(dark, np.int64)] = Flag.LIGHT_LOST
        self.light = SimpleNamespace(mean=np.ones(rest.flags.shape, np.float32), flags=flags)
        self.nodes = FailingNodes(rest, 0.0)
        self.nodes.take_reference(self.light)

    def look(self, which: np.ndarray | slice = slice(None), thought: np.ndarray | None = None) -> int:
        """A frame in which some columns of the patch fail; how many nodes are needed after it."""
        flags = np.zeros_like(self.rest.flags)
        flags[self.rows[:, which], self.cols[:, which]] = Flag.LIGHT_LOST
        warp = Warp(self.q, np.full_like(self.q, 0.01), flags, 0)
        self.nodes.look(self.light, warp, self.q if thought is None else thought)
        return int(np.count_nonzero(self.nodes.need))


def test_nodes_that_fail_where_the_mirror_is_bent_are_needed(rest):
    bench = Bench(rest)
    assert [bench.look() for _ in range(3)] == [16, 16, 16]


def test_nodes_that_fail_where_the_mirror_is_flat_have_dirt_before_them(rest):
    bench = Bench(rest, bent=False)
    assert [bench.look() for _ in range(DIRTY_FRAMES)] == [0] * DIRTY_FRAMES


def test_nodes_at_the_edge_of_what_is_lit_at_rest_are_not_needed(rest):
    # a press moves the edge of the light by less than EDGE_NODES; the row beyond counts as ever
    bench = Bench(rest, dark=(-1,))
    assert bench.look() == 4 * (4 - EDGE_NODES)


def test_nodes_that_look_past_the_lcd_are_not_needed(rest):
    bench = Bench(rest)
    past = bench.q.copy()
    past[bench.rows, bench.cols, 0] = rest.display_size[0] + 5.0
    assert bench.look(thought=past) == 0


def test_nodes_that_fail_by_turns_are_new_only_once(rest):
    bench = Bench(rest)
    grows = []
    for column in np.tile(np.repeat(np.arange(4), 4), 3):
        bench.look(np.array([column]))
        grows.append(bench.nodes.grows)
    # each column once, as it fails first
    assert np.flatnonzero(grows).tolist() == [0, 4, 8, 12]
    bench.nodes.forget()
    bench.look(np.array([0]))
    assert bench.nodes.grows


def test_behind_a_lamps_image_nodes_gain_more_light_than_the_others_and_in_a_brighter_room_they_do_not(rest):
    bench = Bench(rest)
    patch = np.zeros(rest.flags.shape, np.bool_)
    patch[bench.rows, bench.cols] = True
    for room, lamp, named in ((0.0, 0.1, True), (0.3, 0.1, True), (0.3, 0.0, False), (0.0, -0.1, False)):
        mean = 1 + room + lamp * patch
        seen = SimpleNamespace(mean=mean.astype(np.float32), valid=~patch)
        assert bench.nodes.brighter(seen, patch) is named
