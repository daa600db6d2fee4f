"""What can be done with a recording that is played, and read of it."""

from __future__ import annotations

from zeromethod.operating.run_table import VALUES as RUN_VALUES
from zeromethod.operating.table import Method, Quantity, Table

SLOWEST, FASTEST = 0.01, 100.0

_TIME = "time of the recording"
METHODS = (
    Method("play", "Play on from here.", key="p"),
    Method("pause", "Stay at this moment.", key="p"),
    Method(
        "seek",
        "Go to a moment.",
        (Quantity("time_s", "number", _TIME, "s", 0.0, required=True),),
    ),
    Method(
        "speed",
        "Play so many times as fast as it was.",
        (Quantity("value", "number", "how fast; 1 is real time", "", SLOWEST, FASTEST, required=True),),
    ),
    Method(
        "stretch",
        "Play only from one moment to another, over and over.",
        (
            Quantity("from_s", "number", _TIME, "s", 0.0, required=True),
            Quantity("to_s", "number", _TIME, "s", 0.0, required=True),
        ),
    ),
    Method("close", "Close the recording and end the command.", key="q"),
)

_OF_A_RUN_ALONE = frozenset(
    {"read_rate_hz", "latency_ms", "paused", "gain", "contrast", "recording", "recording_trouble"}
)

VALUES = (
    *(one for one in RUN_VALUES if one.name not in _OF_A_RUN_ALONE),
    Quantity("duration_s", "number", "length of the recording", "s", 0.0),
    Quantity("from_s", "number", "beginning of the stretch that is played", "s", 0.0),
    Quantity("to_s", "number", "its end", "s", 0.0),
    Quantity("playing", "boolean", "time goes on"),
    Quantity("speed", "number", "how many times as fast as it was", "", SLOWEST, FASTEST),
)

REPLAY = Table("replay", METHODS, VALUES)
