"""What can be done with a run of the loop, and read of it."""

from __future__ import annotations

from zeromethod.loop.adjustments import LEAST_CONTRAST
from zeromethod.loop.state import State
from zeromethod.operating.table import Method, Quantity, Table

_NOTE = Quantity("note", "text", "why, in your own words", default="")

METHODS = (
    Method("pause", "Freeze what the LCD shows; frames are still measured and read.", key="p"),
    Method("resume", "Go on correcting after a pause.", key="p"),
    Method("zero", "Take the mirror as it is now for the mirror at rest; nothing may touch it.", key="z"),
    Method(
        "gain",
        "Share of each correction that is applied.",
        (Quantity("value", "number", "the share; 1 is the usual one", least=0.01, most=1.0, required=True),),
        key="g",
    ),
    Method(
        "exposure",
        "Exposure time of the camera, where it can be changed during a run.",
        (Quantity("value", "number", "the time", "ms", 0.01, 1000.0, required=True),),
        key="e",
    ),
    Method(
        "target",
        "Contrast of the pattern on the LCD.",
        (Quantity("contrast", "number", "the contrast", "", LEAST_CONTRAST, 1.0, required=True),),
        key="t",
    ),
    Method(
        "record",
        "Begin a recording in a new file (.h5) in the folder of the run.",
        (Quantity("file", "text", "its name; named by date and time when left out"), _NOTE),
        key="r",
    ),
    Method("stop_recording", "End the recording; the run goes on.", key="r"),
    Method(
        "snapshot",
        "Save the newest picture of the camera (.png) and everything read from it (.npz).",
        (_NOTE,),
        key="s",
    ),
    Method(
        "mark",
        "Mark this moment in the recording and in the history.",
        (Quantity("note", "text", "what happened", default=""),),
        key="m",
    ),
    Method("stop", "End the run; what was measured is kept.", key="q"),
)


def _number(
    name: str, doc: str, unit: str = "", least: float | None = None, most: float | None = None
) -> Quantity:
    return Quantity(name, "number", doc, unit, least, most)


def _count(name: str, doc: str, unit: str = "") -> Quantity:
    return Quantity(name, "integer", doc, unit, 0)


VALUES = (
    Quantity("state", "text", f"one of: {', '.join(State)}"),
    Quantity("reason", "text", "why the loop is in that state"),
    Quantity("advice", "text", "what to do now; empty for nothing"),
    Quantity("fresh", "boolean", "the readings are of now: false while they are held, lost or not known"),
    Quantity("doubt", "text", "why depth is not to be relied on; empty where it is"),
    Quantity("phase", "text", "part of a simulated scenario; empty where unknown"),
    _number("time_s", "time of the newest step, since the first", "s", 0),
    _count("step", "number of the newest step"),
    _count("frame", "number of its frame by the camera's own count; null without one"),
    _number("peak_mm", "depth at the deepest point, positive into the rubber", "mm"),
    _number("peak_sigma_mm", "standard deviation of peak_mm", "mm", 0),
    _number("peak_x_mm", "where that point is, world x", "mm"),
    _number("peak_y_mm", "world y", "mm"),
    _number("peak_x_sigma_mm", "standard deviation of peak_x_mm", "mm", 0),
    _number("peak_y_sigma_mm", "standard deviation of peak_y_mm", "mm", 0),
    Quantity("peak_where", "text", "measured, beside a contact, or inside a contact"),
    _number("peak_time_s", "time of the frame that the peak was read from", "s", 0),
    _number("depth_sigma_um", "standard deviation of depth, median over the nodes", "µm", 0),
    _number("fine_peak_mm", "depth at the deepest place of every pixel's depth; null without --fine", "mm"),
    _number("fine_peak_sigma_mm", "standard deviation of fine_peak_mm", "mm", 0),
    _number("fine_time_s", "time of the newest frame that every pixel was read from; null without", "s", 0),
    Quantity("fine_doubt", "text", "why every pixel's depth is not to be relied on; empty where it is"),
    _number("force_normal_n", "force of all contacts into the rubber; null: not known", "N"),
    _number("force_normal_sigma_n", "standard deviation of force_normal_n", "N", 0),
    _number("force_shear_n", "force along the mirror, which no depth shows; null", "N", 0),
    Quantity(
        "contacts",
        "list",
        "what touches: id, x_mm, y_mm, area_mm2, major_mm, minor_mm, angle_deg, depth_mm, force_n",
    ),
    Quantity(
        "pointers",
        "list",
        "last pointer events of an interactive surface, as browsers have them: number, type, pointerId, x, y",
    ),
    Quantity("approach", "text", "what the watch camera sees come; empty for a rig without one"),
    _number("contact_s", "time until it touches, from its frame; null: nothing comes", "s"),
    _number("contact_sigma_s", "standard deviation of contact_s", "s", 0),
    _number("contact_x_mm", "where it will touch, world x", "mm"),
    _number("contact_y_mm", "world y", "mm"),
    _number("contact_sigma_mm", "standard deviation of that place", "mm", 0),
    Quantity("rubbing", "text", "what a texture that rubs does; empty where none does, or without --rubbing"),
    Quantity("rubbing_slips", "boolean", "it slides; null: not known"),
    _number("rubbing_share", "share of the area looked at that is in contact", "", 0, 1),
    _number("rubbing_spots_per_cm2", "spots in contact", "1/cm²", 0),
    _number("rubbing_spot_mm2", "their mean area", "mm²", 0),
    _number("rubbing_speed_mm_s", "speed of sliding; null: not known, aliased", "mm/s", 0),
    _number("rubbing_sigma_speed_mm_s", "standard deviation of rubbing_speed_mm_s", "mm/s", 0),
    _number("rubbing_pitch_mm", "from ridge to ridge, or row to row", "mm", 0),
    Quantity("rubbing_aliased", "boolean", "it moves over half a pitch from frame to frame, or blurs"),
    _number("residual_px", "how far the camera's picture is from the target, rms", "camera px", 0),
    _number("valid_share", "share of the nodes visible at rest that are measured", "", 0, 1),
    _number("loop_rate_hz", "frames that went round the loop, per second of the last two", "1/s", 0),
    _number("read_rate_hz", "surfaces that were read, per second of the last two", "1/s", 0),
    _count("dropped", "frames that the camera lost since the start", "frames"),
    _number("loop_ms", "from frame in hand to command", "ms", 0),
    _number("delay_ms", "from mid-exposure until the panel is half-way to the new picture", "ms"),
    _number("latency_ms", "from mid-exposure until the surface was read; null in simulated time", "ms", 0),
    Quantity("paused", "boolean", "corrections are paused"),
    Quantity("calibrated", "boolean", "the geometry is known; without, depth is relative"),
    Quantity("calibration", "text", "which calibration, and how old; or that there is none"),
    _number("calibration_sigma_percent", "what the calibration leaves open, of a press", "%", 0),
    _number("gain", "share of each correction that is applied", "", 0, 1),
    _number("exposure_ms", "exposure time of the newest frame", "ms", 0),
    _number("contrast", "contrast of the target", "", 0, 1),
    Quantity("recording", "text", "file that is being recorded; empty for none"),
    Quantity("recording_trouble", "text", "what is not kept; empty while all is"),
    Quantity("simulated_time", "boolean", "the run's clock is simulated: it waits for the computation"),
)

RUN = Table("run", METHODS, VALUES)
