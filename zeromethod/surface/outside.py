"""What presses outside the view."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Outside:
    """What presses outside the view: where about, mm, and how much.

    q_mm2: depth far away times distance, which is force / (pi E), E = modulus / (1 - nu^2); sigma_q_mm2: its
    standard deviation.
    """

    x_mm: float
    y_mm: float
    q_mm2: float
    sigma_q_mm2: float
