import numpy as np

from zeromethod.loop.unsteady_nodes import KEPT_S, UnsteadyNodes
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

FRAME_NS = 16_666_667
SHAPE = (6, 7)


def learn(
    nodes: UnsteadyNodes, number: int, failing: bool, flag: Flag = Flag.LIGHT_LOST, moved_lcd_px: float = 0.0
) -> np.ndarray | None:
    """moved_lcd_px: of all nodes since the frame before."""
    flags = np.zeros(SHAPE, np.uint16)
    flags[3, 3] = flag if failing else 0
    q = np.zeros((*SHAPE, 2))
    return nodes.learn(Warp(q + moved_lcd_px, q, flags, 10**9 + number * FRAME_NS), q)


def test_a_node_that_fails_once_is_followed_as_ever():
    nodes = UnsteadyNodes(SHAPE)
    assert all(learn(nodes, k, failing=3 <= k < 20) is None for k in range(40))


def test_a_node_that_fails_twice_is_slow_with_its_neighbours_and_recovers():
    nodes = UnsteadyNodes(SHAPE)
    found = [learn(nodes, k, failing=k % 8 >= 4) for k in range(16)]
    assert found[11] is None
    assert np.count_nonzero(found[12]) == 9
    assert found[12][2:5, 2:5].all()
    assert learn(nodes, 12 + round(KEPT_S * 60) + 2, failing=False) is None


def test_failures_far_apart_or_of_mixed_pictures_do_not_count():
    apart, mixed = UnsteadyNodes(SHAPE), UnsteadyNodes(SHAPE)
    assert all(learn(apart, k, failing=k % 60 == 5) is None for k in range(200))
    assert all(learn(mixed, k, failing=k % 8 >= 4, flag=Flag.MIXED) is None for k in range(60))


def test_while_the_mirror_moves_nodes_beside_seams_are_followed_as_ever():
    nodes = UnsteadyNodes(SHAPE, at_rest=True)
    found = [learn(nodes, k, failing=k % 8 >= 4) for k in range(16)]
    assert np.count_nonzero(found[12]) == 9
    assert learn(nodes, 16, failing=False, moved_lcd_px=0.2) is None
    assert np.count_nonzero(learn(nodes, 17, failing=False)) == 9
