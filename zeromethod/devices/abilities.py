"""Optional abilities of devices; the only place that asks for them.

The abilities are the optional protocols of `zeromethod.devices.protocols`. A device that lacks one, or has
something else by its name (a lab's own `scenario`), does not have the ability.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np

from zeromethod.devices.protocols import Script, ScriptPhase, TrueMirror


def poll_of(display: object) -> Callable[[], None] | None:
    """`poll` of a `PollingDisplay`."""
    poll: Callable[[], None] | None = _method(display, "poll")
    return poll


def is_asleep(display: object) -> bool:
    """Whether a `SleepingDisplay` is asleep; False for any other."""
    asleep = getattr(display, "asleep", False)
    return isinstance(asleep, bool | np.bool_) and bool(asleep)


def warnings_of(display: object) -> tuple[str, ...]:
    """Warnings of a `WarningDisplay`."""
    lines = getattr(display, "warnings", ())
    return tuple(map(str, lines)) if isinstance(lines, list | tuple) else ()


def dropped_refreshes_of(display: object) -> int | None:
    """Refreshes that a `CountingDisplay` missed; None for any other."""
    count = getattr(display, "dropped_refreshes", None)
    return int(count) if isinstance(count, int | np.integer) else None


def exposure_setter_of(camera: object) -> Callable[[float], float] | None:
    """`set_exposure` of an `ExposingCamera`; None for any other, or one that is set once and for all."""
    setter: Callable[[float], float] | None = _method(camera, "set_exposure", 0.01)
    return setter if getattr(camera, "exposure_settable", True) else None


def identity_of(camera: object) -> tuple[str, str]:
    """(serial, model) of an `IdentifiedCamera`, "" for what is not known."""
    return _text(camera, "serial"), _text(camera, "model")


def name_of(display: object) -> str:
    """Name of a `NamedDisplay`, "" for any other."""
    return _text(display, "name")


def truth_of(camera: object) -> Callable[[int], TrueMirror] | None:
    """`truth` of a `TruthfulCamera`."""
    truth: Callable[[int], TrueMirror] | None = _method(camera, "truth", 0)
    return truth


def script_of(camera: object) -> Script | None:
    """Scenario of a `ScriptedCamera`."""
    script = getattr(camera, "scenario", None)
    if not (isinstance(script, Script) and isinstance(script.duration_s, int | float)):
        return None
    known = isinstance(script.phases, list | tuple) and all(
        isinstance(one, ScriptPhase) for one in script.phases
    )
    return script if known and _method(script, "phase_at", 0) is not None else None


def _method(device: object, name: str, *arguments: object) -> Any:
    """Method of that name; None where there is none that takes these arguments."""
    method = getattr(device, name, None)
    if not callable(method):
        return None
    try:
        inspect.signature(method).bind(*arguments)
    except TypeError:
        return None
    except ValueError:
        pass  # of compiled code no signature may be known
    return method


def _text(device: object, name: str) -> str:
    value = getattr(device, name, "")
    return value if isinstance(value, str) else ""
