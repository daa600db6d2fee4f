"""One run as it goes to whoever carries it out: everything in it, so that any process can, in any order."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from zeromethod.rig.model import Rig
from zeromethod.study.press import PressTable

Message = dict[str, Any]
"""A task or an outcome as JSON has it."""


LIMIT_S = 3600.0
"""How long a run may take unless its study says otherwise."""

WHOLE_LIMIT = 1 << 63
"""Whole numbers from here on do not fit a column of the results."""


@dataclass(frozen=True)
class Task:
    """What a run needs.

    rig: what is believed of the bench. bench: what it truly is, where that differs. press: in place of the
    rig's. settings: of the procedure itself. recording: path of the recording to read, where there is one.
    limit_s: how long it may take in the host's time; whoever carries it out then gives it up.
    """

    run: int
    seed: int
    procedure: str
    rig: Rig
    bench: Rig | None = None
    press: PressTable | None = None
    frames: int | None = None
    seconds: float | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    metrics: tuple[str, ...] = ()
    recording: str | None = None
    rig_settings: Mapping[str, Any] = field(default_factory=dict)
    limit_s: float = LIMIT_S

    def message(self) -> Message:
        """As JSON has it."""
        return {
            **{
                name: getattr(self, name)
                for name in ("run", "seed", "procedure", "frames", "seconds", "limit_s")
            },
            "rig": _dumped(self.rig),
            "bench": self.bench and _dumped(self.bench),
            "press": self.press and self.press.model_dump(mode="json"),
            "settings": dict(self.settings),
            "metrics": list(self.metrics),
            "recording": self.recording,
            "rig_settings": dict(self.rig_settings),
        }

    @classmethod
    def of(cls, message: Message) -> Task:
        """From JSON."""
        bench, press = message["bench"], message["press"]
        return cls(
            **{
                **message,
                "rig": _rig(message["rig"]),
                "bench": bench and _rig(bench),
                "press": press and PressTable.model_validate_json(json.dumps(press), strict=True),
                "metrics": tuple(message["metrics"]),
            }
        )


Figures = Mapping[str, Any]
"""Numbers, words, true or false, None; by dotted names."""


@dataclass(frozen=True)
class Procedure:
    """What a run does.

    figures: name and meaning, unit included, of everything that it can tell. settings: keys of its own with
    their defaults. It may raise MeasurementError or InputError; the run has then failed.
    """

    carry_out: Callable[[Task], Figures]
    figures: Mapping[str, str]
    settings: Mapping[str, Any] = field(default_factory=dict)
    reads_recordings: bool = False


def _dumped(rig: Rig) -> dict[str, Any]:
    dumped: dict[str, Any] = rig.model_dump(mode="json", exclude_unset=True)
    return dumped


def _rig(data: dict[str, Any]) -> Rig:
    return Rig.model_validate_json(json.dumps(data), strict=True)
