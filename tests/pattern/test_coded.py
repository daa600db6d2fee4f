"""Fringes drawn over parts of the picture: as their formula has them, at places of the panel."""

import numpy as np
import pytest

from zeromethod.pattern import PatternRenderer, Response, Target
from zeromethod.pattern.coded import PICTURES, Coded
from zeromethod.warp.grid import NodeGrid

GRID = NodeGrid((256, 320))
U, V = GRID.mesh()
REST = np.stack([50 + 0.9 * U, 30 + 0.95 * V], axis=-1)
SIZE = (420, 330)
ROW, COL = np.indices((SIZE[1], SIZE[0]), dtype=float)
PARTS = np.array([[100.0, 80.0, 160.0, 140.0], [200.5, 60.0, 230.0, 90.0]])


@pytest.mark.parametrize("number", [0, 5, PICTURES - 1])
def test_fringes_lie_over_their_parts_and_leave_the_rest(gl_context, number):
    response, target = Response(2.2), Target()
    renderer = PatternRenderer(gl_context, GRID, REST, SIZE, target, response)
    coded = Coded(number, PARTS)
    drawn, plain = renderer.image(REST, coded=coded).astype(float), renderer.image(REST)
    inside = np.zeros(drawn.shape, bool)
    for left, top, right, bottom in PARTS:
        inside |= (left <= COL) & (right >= COL) & (top <= ROW) & (bottom >= ROW)
    place = ROW if coded.axis else COL
    wave = np.cos(2 * np.pi * place / coded.period_px - coded.shift_rad)
    light = target.mean * (1 + target.contrast * wave)
    # half a grey code of rounding, and a quarter of the tabulated response
    np.testing.assert_allclose(drawn[inside], response.inverse(light)[inside], atol=0.75)
    assert (drawn[~inside] == plain[~inside]).all()


def test_after_a_burst_the_target_is_whole_again(gl_context):
    renderer = PatternRenderer(gl_context, GRID, REST, SIZE, Target(), Response(2.2))
    before = renderer.image(REST)
    renderer.image(REST, coded=Coded(3, PARTS))
    assert (renderer.image(REST) == before).all()
