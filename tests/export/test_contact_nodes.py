"""Which node lies in which contact."""

from types import SimpleNamespace

import numpy as np

from zeromethod.export.contact_nodes import contact_ids

TURN = np.linspace(0, 2 * np.pi, 64, endpoint=False)


def test_nodes_within_a_border_have_its_id_and_no_others():
    x, y = np.meshgrid(np.linspace(30, 50, 81), np.linspace(-8, 8, 65))
    x[0, :5] = np.nan
    rows = np.zeros(2, [("id", "i4"), ("outline_mm", "f4", (64, 2))])
    for row, (number, middle, radius) in zip(rows, ((1, 36.1, 2.0), (4, 44.07, 3.0)), strict=True):
        row["id"] = number
        row["outline_mm"] = np.stack([middle + radius * np.cos(TURN), radius * np.sin(TURN)], axis=-1)
    found = contact_ids(SimpleNamespace(x_mm=x, y_mm=y), rows)
    # a polygon of 64 corners lies up to 0.0012 radii inside its circle
    expected = np.where(np.hypot(x - 36.1, y) < 1.997, 1, np.where(np.hypot(x - 44.07, y) < 2.996, 4, 0))
    assert (found == expected).all()
