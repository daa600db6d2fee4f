"""Fabrics are told apart by what their learned pieces have in common, over how these scatter."""

from typing import Any

import numpy as np
import pytest

from benchmarks.rubbing import FABRICS, LEARNED, SERIES, told_apart

Found = list[list[dict[str, Any]]]


@pytest.fixture
def found() -> Found:
    """Two series of each kind: pitches 40 of their standard deviations apart, shares that scatter widely."""
    draw = np.random.default_rng(4)
    return [
        [
            {
                "kind": kind,
                "share": 0.3 + 0.1 * draw.standard_normal(),
                "spots_per_cm2": 200 + 50 * draw.standard_normal(),
                "spot_mm2": 0.1 + 0.03 * draw.standard_normal(),
                "pitch_mm": 0.5 + 0.04 * kind + 0.001 * draw.standard_normal(),
            }
            for _ in range(SERIES)
        ]
        for _ in range(2)
        for kind in range(len(FABRICS))
    ]


def test_what_scatters_least_within_a_fabric_tells_it(found: Found) -> None:
    right, count, wrong = told_apart(found)
    assert (right, count, wrong) == (len(FABRICS) * (2 * SERIES - LEARNED), right, [])


def test_a_piece_of_another_fabric_is_named_and_one_with_a_figure_not_known_is_wrong(found: Found) -> None:
    found[13][0]["kind"] = 7
    found[14][0]["pitch_mm"] = None
    right, count, wrong = told_apart(found)
    assert count - right == len(wrong) == 2
    assert "7 as 3" in wrong
