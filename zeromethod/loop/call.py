"""A call of one of the run's methods, as the recording keeps it."""

from __future__ import annotations

from dataclasses import dataclass

DONE = "done"
"""Outcome of a call that was carried out; any other says why it was refused."""


@dataclass(frozen=True, slots=True)
class Call:
    """One call. arguments: JSON. source: who called: terminal, page, http, socket or python.

    outcome: `DONE`, or why it was refused.
    """

    method: str
    arguments: str
    source: str
    outcome: str = DONE
