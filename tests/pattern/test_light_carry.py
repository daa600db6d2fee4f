"""Codes summed as light in time, against the same sum in numpy."""

import numpy as np
import pytest

from zeromethod.pattern import PatternRenderer, Response, Target
from zeromethod.pattern.light_carry import FORGET_ABOVE
from zeromethod.pattern.stepping import shift_of
from zeromethod.warp.grid import NodeGrid

GRID = NodeGrid((128, 160))
U, V = GRID.mesh()
SIZE = (220, 180)
ROW, COL = np.indices((SIZE[1], SIZE[0]), dtype=float)
Q = np.stack([U + 30.3, V + 25.8], axis=-1)
INSIDE = (U[0, 2] + 31 < COL) & (U[0, -3] + 30 > COL) & (V[2, 0] + 26 < ROW) & (V[-3, 0] + 25 > ROW)
TARGET = Target()
REGIONAL = ((1.0, 0.8), (1.1, 0.9))


def wanted(shift):
    u, v = COL - 30.3 + shift[0] * TARGET.period_px, ROW - 25.8 + shift[1] * TARGET.period_px
    return TARGET.light(u, v)[INSIDE]


@pytest.mark.parametrize("exponent", [None, REGIONAL])
@pytest.mark.parametrize("step", [0, 16])
def test_the_mean_light_of_pictures_is_wrong_by_what_the_last_left_out(gl_context, exponent, step):
    response = Response(2.2, exponent=exponent)
    powers = 1.0 if exponent is None else response.exponents((SIZE[1], SIZE[0]))[INSIDE]
    renderer = PatternRenderer(gl_context, GRID, Q, SIZE, TARGET, response, carry=True)
    owed, apart, wrong = 0.0, [], []
    for number in range(24):
        light = wanted(shift_of(step, number))
        codes = renderer.image(Q, shift=shift_of(step, number))[INSIDE]
        owed_before = owed
        owed = owed + light - response.light(codes) ** powers
        # the nearest code to what is wanted and owed, by numpy; the table of codes is good to 0.002 of one
        nearest = response.inverse(np.clip(light + owed_before, 0, 1) ** (1 / powers))
        apart.append(np.abs(codes - nearest).max())
        wrong.append(np.sqrt(np.mean(owed**2)) / (number + 1))
    assert max(apart) < 0.51
    steps = response.light(codes + 0.5) ** powers - response.light(codes - 0.5) ** powers
    assert (
        np.abs(owed) < 0.52 * steps + 1e-4
    ).all()  # half a code, and 2e-6 of the kept light in each picture
    # 1 / N, and of one picture what rounding makes of an even spread
    assert wrong[0] == pytest.approx(np.sqrt(np.mean(steps**2) / 12), rel=0.1)
    assert wrong[23] == pytest.approx(wrong[0] / 24, rel=0.15)


def test_what_is_owed_is_forgotten_where_another_picture_is_shown(gl_context):
    response = Response(2.2)
    jump = (0.5, 0.5)
    renderer, fresh = (
        PatternRenderer(gl_context, GRID, Q, SIZE, TARGET, response, carry=True) for _ in range(2)
    )
    for _ in range(3):
        renderer.image(Q)
    after, first = renderer.image(Q, shift=jump)[INSIDE], fresh.image(Q, shift=jump)[INSIDE]
    changed = np.abs(wanted(jump) - wanted((0.0, 0.0)))
    assert (after == first)[changed > FORGET_ABOVE + 0.01].all()
    assert not (after == first)[changed < FORGET_ABOVE - 0.01].all()


def test_outside_the_warp_it_is_the_mean_light_as_without(gl_context):
    response = Response(2.2)
    plain, carrying = (
        PatternRenderer(gl_context, GRID, Q, SIZE, TARGET, response, carry=carry) for carry in (False, True)
    )
    first, still = carrying.image(Q), plain.image(Q)
    # nothing is owed at first but the light of what was there before the first picture: none
    assert np.abs(first.astype(int) - still).max() == 0
    assert (carrying.image(Q)[:10] == still[:10]).all()
