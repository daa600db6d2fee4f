"""What a frame means for the state of the loop, and what its step keeps of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from zeromethod.devices.contract import wrong_numbers
from zeromethod.devices.protocols import Frame
from zeromethod.loop.circle import FrameResult
from zeromethod.loop.events import Event, Notice
from zeromethod.loop.frame_check import FrameVerdict
from zeromethod.loop.state import Doubt, Outcome, StepOutcome

BURST_AHEAD = "no picture nulls a part of the view: coded ones will read it; keep what is pressed still"
BURST_WORDS = "coded pictures read the warp where none can null it; keep what is pressed still"
LAMP_AHEAD = (
    "a lamp's image lies over a part of the view, which coded pictures will read: switch it off or shade it"
)
LAMP_WORDS = "coded pictures read the warp behind a lamp's image: switch it off or shade it"
"""The same where the nodes have more light than at rest."""


def burst_words(result: FrameResult) -> str:
    """What is done about nodes that no picture nulls."""
    ahead, now = (LAMP_AHEAD, LAMP_WORDS) if result.lamp_image else (BURST_AHEAD, BURST_WORDS)
    return now if result.coded else ahead


def frame_outcome(
    verdict: FrameVerdict,
    result: FrameResult,
    refusal: Notice | None,
    events: tuple[Event, ...],
    paused: bool,
    at_rest: Callable[[], bool],
    doubt: Doubt | None,
    passive: bool,
    coming: str = "",
) -> StepOutcome:
    """What became of a frame, for `next_status`.

    at_rest: whether the mirror is untouched; asked only where the frame was measured. doubt: why readings
    must not be trusted. passive: the pattern is never warped. coming: what is about to touch, in words.
    """
    words = refusal.words if refusal else ""
    if verdict.wrong:
        return StepOutcome(Outcome.FAILED, words)
    if result.refusal is Event.LIGHT_OFF:
        return StepOutcome(Outcome.MEASURED, words)
    if paused:
        return StepOutcome(Outcome.PAUSED, "paused: frames are measured, the picture stays")
    if refusal is not None or result.measured is None:
        return StepOutcome(Outcome.HELD, words)
    blinded = "the camera is blinded: too bright" if Event.SATURATED in events else ""
    unread = burst_words(result) if result.unread else ""
    seen = result.residual_rms_px, result.valid_share, at_rest(), result.covered_share
    return StepOutcome(Outcome.MEASURED, blinded, *seen, doubt, result.order, unread, passive, coming)


def frame_figures(frame: Frame, verdict: FrameVerdict, result: FrameResult) -> dict[str, Any]:
    """Fields of a `Step` that are its frame's alone; arrays that the circle changes are copied."""
    figures: dict[str, Any] = {
        "frame_number": None if wrong_numbers(frame) else frame.number,
        "sensed": verdict.refusal is None,
        "image": frame.image,
        "residual": result.residual and result.residual.copy(),
        "shown": result.observation and result.observation.shown.copy(),
        "target": result.observation and result.observation.target,
        "residual_rms_px": result.residual_rms_px,
        "valid_share": result.valid_share,
    }
    if not verdict.wrong:
        figures |= {"dropped": frame.dropped, "exposure_ns": frame.exposure_ns}
    return figures
