import numpy as np

from zeromethod.loop.measured_warp import order_in_doubt


def view(*rows: str) -> np.ndarray:
    return np.array([[c == "#" for c in row] for row in rows])


RING = view("#######", "#.....#", "#.###.#", "#.###.#", "#.....#", "#######")
NOTHING = np.zeros_like(RING)


def test_one_connected_region_is_never_doubted():
    assert order_in_doubt(view("###", "#.#", "###"), np.zeros((3, 3), bool)) is None


def test_an_island_that_was_not_known_before_is_doubted():
    mask = order_in_doubt(RING, NOTHING)
    assert mask is not None
    assert np.argwhere(mask).tolist() == [[2, 2], [2, 3], [2, 4], [3, 2], [3, 3], [3, 4]]


def test_an_island_that_was_known_before_is_believed():
    assert order_in_doubt(RING, RING) is None
    half = NOTHING.copy()
    half[2, 2:5] = True
    assert order_in_doubt(RING, half) is None
    half[2, 2] = False
    assert order_in_doubt(RING, half) is not None


def test_corners_do_not_connect():
    mask = order_in_doubt(view("##..", "##..", "..#.", "...."), np.zeros((4, 4), bool))
    assert mask is not None
    assert np.argwhere(mask).tolist() == [[2, 2]]
