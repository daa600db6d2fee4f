"""What can be done while a bench is set up or calibrated, and read of it."""

from __future__ import annotations

from zeromethod.operating.table import Method, Quantity, Table

_STOP = Method("stop", "End it; what was found so far is kept where it can be.", key="q")

_GUIDE = (
    Quantity("state", "text", "starting, working, done or failed"),
    Quantity("reason", "text", "why it is in that state"),
    Quantity("advice", "text", "what to do now; empty for nothing"),
    Quantity("fresh", "boolean", "the picture is of now"),
    Quantity("step_name", "text", "the present step"),
    Quantity("instruction", "text", "what to do now"),
    Quantity("progress", "number", "how much of the step is done; null: not known", "", 0, 1),
    Quantity("lines", "list", "what was said, newest first"),
    Quantity("verdict", "text", "what was found, once it is done"),
)

_FOCUS = (
    Quantity("focus_score", "number", "how sharp the pattern is", "", 0, 1),
    Quantity("blur_px", "number", "width of the blur", "camera px", 0),
    Quantity("mean_grey", "number", "mean of the picture", "grey levels", 0),
    Quantity("bright_grey", "number", "its brightest places", "grey levels", 0),
    Quantity("full_grey", "number", "the camera's brightest", "grey levels", 0),
    Quantity("saturated_share", "number", "share of the pixels that are too bright", "", 0, 1),
    Quantity("usable_share", "number", "share of the view that can be measured", "", 0, 1),
    Quantity("flicker_share", "number", "change of the light from frame to frame", "", 0),
    Quantity("exposure_ms", "number", "exposure time", "ms", 0),
)

CALIBRATE = Table("calibrate", (_STOP,), _GUIDE)
FOCUS = Table("focus", (_STOP,), (*_GUIDE, *_FOCUS))
