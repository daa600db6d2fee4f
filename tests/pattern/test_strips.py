"""Where coded strips lie and what is drawn in them."""

import numpy as np
import pytest

from zeromethod.pattern import PatternRenderer, Response, Strips, Target
from zeromethod.pattern.strips import CODES, bits_of
from zeromethod.warp.grid import NodeGrid

GRID = NodeGrid((192, 320))
U, V = GRID.mesh()
SIZE = (420, 330)
PLAIN = np.stack([U + 40, V + 50], axis=-1)
TURNED = np.stack([V + 40, 10 + 0.9 * U], axis=-1)
NO_RAY = np.zeros(GRID.shape, np.bool_)
RESPONSE = Response(2.2)
TARGET = Target()


def _strips(q: np.ndarray) -> Strips:
    strips = Strips.of(GRID, q, NO_RAY, SIZE)
    assert strips is not None
    return strips


def test_from_code_to_code_exactly_one_gray_bit_and_the_check_change():
    codes = np.array([bits_of(code) for code in range(CODES)])
    assert len({tuple(bits) for bits in codes}) == CODES
    changes = codes != np.roll(codes, -1, axis=0)
    assert changes[:, :4].sum(axis=1).tolist() == [1] * CODES
    assert changes[:, 4].all()


def test_strips_lie_where_the_panels_first_and_last_rows_are_visible():
    strips = _strips(PLAIN)
    assert strips.along_u
    assert (strips.first.edge_px, strips.last.edge_px) == (15.5, 175.5)
    # read in the middle of their image rows 1..10 and 181..190, and this rest warp adds 50
    np.testing.assert_allclose(strips.first.panel_rows, 55.5)
    np.testing.assert_allclose(strips.last.panel_rows, 235.5)
    turned = _strips(TURNED)
    assert not turned.along_u
    assert turned.first.edge_px == 15.5
    assert turned.last.panel_rows[0] == pytest.approx(10 + 0.9 * 313.5)


def test_strip_moves_in_to_where_the_panel_is_visible_and_needs_room():
    beyond = PLAIN - np.array([0.0, 80.0])  # image rows up to 30 look past the panel
    assert _strips(beyond).first.edge_px == 32 + 15.5
    # only 120 camera px of the edge see the panel: cells of 6 px could not be read
    assert Strips.of(GRID, PLAIN, U > 120, SIZE) is None
    assert Strips.of(GRID, PLAIN - np.array([0.0, 160.0]), NO_RAY, SIZE) is None


def test_nodes_whose_window_touches_a_strip_are_covered_and_no_others():
    # windows are 15 px to either side
    np.testing.assert_array_equal(_strips(PLAIN).covered(GRID), (V - 15 <= 15) | (V + 15 >= 176))


@pytest.mark.parametrize("q", [PLAIN, TURNED], ids=["top and bottom", "left and right"])
def test_code_is_drawn_in_the_strips_and_nothing_else_changes(gl_context, q):
    strips = _strips(q)
    renderer = PatternRenderer(gl_context, GRID, q, SIZE, TARGET, RESPONSE, strips)
    without = PatternRenderer(gl_context, GRID, q, SIZE, TARGET, RESPONSE)
    bare = renderer.image(q)
    assert np.array_equal(bare, without.image(q))
    assert np.array_equal(without.image(q, 5), bare)
    row, col = np.indices((SIZE[1], SIZE[0]), dtype=float)
    u, v = (col - 40, row - 50) if q is PLAIN else ((row - 10) / 0.9, col - 40)
    drawn = (u > U[0, 1]) & (u < U[0, -2]) & (v > V[1, 0]) & (v < V[-2, 0])
    across, along = (v, u) if strips.along_u else (u, v)
    outside = (across > 16.5) & (across < (174.5 if strips.along_u else 302.5))
    white, black = RESPONSE.code(0.95), RESPONSE.code(0.05)
    unit = (GRID.image_shape[1] if strips.along_u else GRID.image_shape[0]) / 20
    cell = (along + 0.5) / unit
    whole = np.abs(cell - np.rint(cell)) > 0.2  # away from the borders between cells
    strip = drawn & (across < 14.5) & whole & (along > 0) & (cell < 20)
    index = np.clip(cell.astype(int), 0, 19)
    for code in (0, 5, 11, 15):
        coded = renderer.image(q, code)
        assert np.array_equal(coded[outside], bare[outside])
        bits = np.array(bits_of(code))[index // 4]
        lit = np.where(np.isin(index % 4, (1, 2)), 1 - bits, bits)
        np.testing.assert_array_equal(coded[strip], np.where(lit, white, black)[strip])


def test_mean_light_of_a_strip_is_the_targets_whatever_the_code(gl_context):
    strips = _strips(PLAIN)
    renderer = PatternRenderer(gl_context, GRID, PLAIN, SIZE, TARGET, Response(1.0), strips)
    for code in range(CODES):
        strip = renderer.image(PLAIN, code)[52:64, 40:360] / 255
        # codes are whole numbers: 1/255 at most between light asked for and drawn
        assert strip.mean() == pytest.approx(TARGET.mean, abs=0.004)
