"""A video of camera, residual and depth side by side, at the pace of the recording."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from zeromethod.arrays import Bytes, Ints
from zeromethod.atomic_write import atomic_write
from zeromethod.export.lattice import MapLattice
from zeromethod.export.picture import Picture, Scales
from zeromethod.export.selection import SelectedSteps, needed
from zeromethod.export.source import MapSource
from zeromethod.recording.recording import Recording
from zeromethod.surface import Surface

CODECS = ("libx264", "mpeg4")
"""The first that the library has."""

_FASTEST_HZ = 240.0
_LOOKED_AT = 9
"""Frames that the camera's grey scale is taken from."""


def export_video(
    recording: Recording, selected: SelectedSteps, path: Path, advance: Callable[[], None]
) -> dict[str, Any]:
    """Write an MP4 of constant frame rate, one frame per median interval of the selected.

    Each frame shows the newest moment until then: a pause of the recording is a pause of the video.
    Returns what was written: times, frames, rate, length, size, codec.
    """
    av = needed("av")
    rate = _rate(selected)
    shown = _shown(selected, float(rate))
    picture = _picture(recording, selected)
    with atomic_write(path) as part, av.open(str(part), "w", format="mp4") as file:
        codec = next(name for name in CODECS if _has(av, name))
        stream = file.add_stream(codec, rate=rate)
        stream.height, stream.width = picture.shape
        stream.pix_fmt = "yuv420p"
        if codec == "libx264":
            stream.options = {"crf": "18", "preset": "veryfast"}
        else:
            stream.bit_rate = 12_000_000
        for number, image in enumerate(_pictures(recording, selected, picture, shown, advance)):
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts, frame.time_base = number, 1 / rate
            file.mux(stream.encode(frame))
        file.mux(stream.encode(None))
    return {
        "times": len(selected.steps),
        "frames": len(shown),
        "rate_hz": float(rate),
        "length_s": len(shown) / float(rate),
        "columns": picture.shape[1],
        "rows": picture.shape[0],
        "codec": codec,
    }


def _has(av: Any, name: str) -> bool:
    try:
        av.codec.Codec(name, "w")
    except ValueError:
        return False
    return True


def _rate(selected: SelectedSteps) -> Fraction:
    """Frames per second."""
    hz = min(1.0 / selected.interval_s, _FASTEST_HZ) if selected.interval_s > 0.0 else 1.0
    return Fraction(hz).limit_denominator(1001)


def _shown(selected: SelectedSteps, rate_hz: float) -> Ints:
    """Which moment every frame of the video shows."""
    since = selected.time_s - selected.time_s[0]
    frames = round(float(since[-1]) * rate_hz) + 1
    until = (np.arange(frames) + 0.5) / rate_hz
    return np.maximum(np.searchsorted(since, until, side="right") - 1, 0)


def _picture(recording: Recording, selected: SelectedSteps) -> Picture:
    """The picture, with scales for all selected steps."""
    within = np.isin(recording.steps["number"], selected.steps)
    peaks = recording.peaks[np.isin(recording.peaks["step"], selected.steps)]
    some = selected.steps[np.linspace(0, len(selected.steps) - 1, _LOOKED_AT).astype(int)]
    images = [image for image in map(recording.image, some) if image is not None]
    first, inner = MapSource(recording).first(selected.steps.tolist()), recording.grid.inner
    x_mm, y_mm = (one[inner].astype(np.float64) for one in (first.x_mm, first.y_mm))
    scales = Scales.of(images, recording.steps["residual_rms_px"][within], peaks["depth_mm"])
    return Picture(recording.grid, MapLattice.covering(x_mm, y_mm), scales)


def _pictures(
    recording: Recording,
    selected: SelectedSteps,
    picture: Picture,
    shown: Ints,
    advance: Callable[[], None],
) -> Iterator[Bytes]:
    """Picture of every frame of the video: each moment drawn once, the last surface kept until the next."""
    peaks = {int(row["step"]): row for row in recording.peaks}
    surface: Surface | None = None
    rms_px = dict(
        zip(recording.steps["number"].tolist(), recording.steps["residual_rms_px"].tolist(), strict=True)
    )
    peak_words = ""
    image = np.zeros((*picture.shape, 3), np.uint8)
    done = 0
    for index in shown:
        while done <= index:
            step = int(selected.steps[done])
            found = recording.surface(step)
            if found is not None and (found.valid.any() or not recording.is_damaged("surface", step)):
                surface = found
            if step in peaks and np.isfinite(peaks[step]["depth_mm"]):
                peak_words = f"   peak {1e3 * float(peaks[step]['depth_mm']):8.3f} µm"
            # of a damaged frame the picture before stays
            if done == index and (frame := recording.image(step)) is not None:
                words = f"{selected.time_s[done]:8.3f} s   {selected.states[done]:<9}"
                words += f"   residual rms {rms_px.get(step, np.nan):7.4f} px{peak_words}"
                image = picture.draw(frame, recording.residual(step), surface, words)
            advance()
            done += 1
        yield image
