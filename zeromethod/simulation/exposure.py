"""What one exposure adds up: the moving mirror and the changing panel, cut into instants."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from zeromethod.simulation.panel import Panel, Presentation
from zeromethod.simulation.renderer import Piece
from zeromethod.simulation.scenario import Scenario

_GAUSS_LEGENDRE = 1 / np.sqrt(3.0)


def exposure_pieces(
    scenario: Scenario,
    panel: Panel,
    presentations: Sequence[Presentation],
    from_ns: int,
    to_ns: int,
    lit: bool = True,
) -> list[Piece]:
    """Pieces of the exposure [from_ns, to_ns]; their weights add up to 1.

    It is cut where the scenario jumps or bends. A part in which the mirror stands still is one piece; one in
    which it moves is two, with the mirror at the two Gauss-Legendre instants (exact for motion whose effect
    is cubic in time) and the panel's light of each half. `lit` False: the panel's light is off.
    """
    cuts = [from_ns, *scenario.bends_ns(from_ns, to_ns), to_ns]
    pieces = []
    for start, end in pairwise(cuts):
        middle, half = (start + end) // 2, (end - start) / 2
        if scenario.moving(start, end):
            shift = round(half * _GAUSS_LEGENDRE)
            parts = [(start, middle, middle - shift), (middle, end, middle + shift)]
        else:
            parts = [(start, end, middle)]
        for part_from, part_to, at in parts:
            pictures = panel.weights(presentations, part_from, part_to)
            if not lit:
                pictures = [(handle, np.zeros_like(share)) for handle, share in pictures]
            weight = (part_to - part_from) / (to_ns - from_ns)
            pieces.append(Piece(weight, scenario.mirror_at(at), pictures))
    return pieces
