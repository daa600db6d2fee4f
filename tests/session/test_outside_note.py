"""What presses outside the view is said once, with its place and force."""

import numpy as np
import pytest

from zeromethod.rig.tables import Rubber
from zeromethod.session.outside_note import OutsideNote
from zeromethod.surface import Surface
from zeromethod.surface.outside import Outside
from zeromethod.surface.surface import Anchor

NONE = np.zeros((2, 2), bool)


def surface(outside):
    one = np.zeros((2, 2))
    anchor = Anchor("loads", ~NONE, 0.0, outside=outside)
    return Surface(one, np.zeros((2, 2, 2)), one, one, one, np.zeros((2, 2, 2)), ~NONE, NONE, anchor, 0, 1)


@pytest.mark.parametrize(
    ("rubber", "words"),
    [
        # F = pi E q, E = 1 / (1 - 0.25)
        (Rubber(youngs_modulus_mpa=1.0, poisson=0.5), "near x 95, y -1 mm, with about 4.2 N:"),
        (Rubber(), "near x 95, y -1 mm: it is part of depth"),
    ],
)
def test_it_is_said_when_it_begins_and_again_when_it_comes_back(rubber, words):
    note, pressed = OutsideNote(rubber), surface(Outside(95.2, -0.6, 1.0, 0.1))
    note.look(pressed)
    (said,) = note.take()
    assert words in said
    note.look(pressed)
    assert note.take() == ()
    note.look(surface(None))
    note.look(None)
    note.look(pressed)
    assert note.take() == (said,)
