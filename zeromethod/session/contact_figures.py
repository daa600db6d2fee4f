"""Contacts of a run, each in one row: what touched, from when to when, and what truly did."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from zeromethod.loop.step import StepFigures
from zeromethod.mechanics.yielding import NO_MODULUS
from zeromethod.rig.model import Rig

Rows = list[dict[str, Any]]


def contact_rows(records: Sequence[StepFigures]) -> Rows:
    """One row per contact, by id: times, frames, and the medians of its figures.

    Medians are those over frames of the hold, where there are any; a contact's edge figures while it comes
    down are not its own.
    """
    seen: dict[int, list[tuple[StepFigures, dict[str, Any]]]] = {}
    for record in records:
        for contact in record.touching:
            seen.setdefault(contact.id, []).append((record, asdict(contact)))
    return [
        {
            "id": number,
            "from_s": found[0][0].time_s,
            "to_s": found[-1][0].time_s,
            "frames": len(found),
            **_medians([row for record, row in found if record.phase == "hold"] or [row for _, row in found]),
        }
        for number, found in sorted(seen.items())
    ]


def force_figures(records: Sequence[StepFigures], rig: Rig) -> dict[str, Any]:
    """Sum of all contacts' forces: medians over frames with contacts, of the hold where there are any.

    force_n, sigma_n: None with the `reason` where no force is read.
    """
    if rig.rubber.youngs_modulus_mpa is None:
        return {"force_n": None, "sigma_n": None, "reason": NO_MODULUS}
    found = [one for one in records if np.isfinite(one.total_force_n)]
    found = [one for one in found if one.phase == "hold"] or found
    if not found:
        return {"force_n": None, "sigma_n": None, "reason": "nothing touched"}
    force, sigma = np.median([(one.total_force_n, one.sigma_total_force_n) for one in found], axis=0)
    return {"force_n": float(force), "sigma_n": float(sigma), "reason": ""}


def true_contact_rows(records: Iterable[StepFigures]) -> Rows:
    """One row per true contact, by its number in the scenario: medians of its figures in these frames."""
    seen: dict[int, Rows] = {}
    for record in records:
        for contact in record.truth.contacts if record.truth is not None else ():
            seen.setdefault(contact.id, []).append(contact._asdict())
    return [{"id": number, **_medians(rows)} for number, rows in sorted(seen.items())]


def _medians(rows: Rows) -> dict[str, float]:
    return {key: float(np.median([row[key] for row in rows])) for key in rows[0] if key != "id"}
