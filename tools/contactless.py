"""Picture of contactless sensing at work: python tools/contactless.py docs/contactless.png."""

from __future__ import annotations

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from zeromethod.approach import Approach, WatchReader
from zeromethod.clock import SimulatedClock
from zeromethod.rig.load import load_rig
from zeromethod.simulation.path import place_at
from zeromethod.simulation.watch_camera import SimulatedWatchCamera

TOUCH_S, SHOWN_S = 2.3, (1.0, 1.7, 2.25)


def main(file: str) -> None:
    """Draw what the watch camera sees of the packaged scenario, and what is read from it."""
    rig = load_rig("contactless")
    camera, reader = SimulatedWatchCamera(rig, SimulatedClock()), WatchReader(rig)
    seen: list[tuple[float, Approach]] = []
    images = {}
    for frame in range(round(30 * TOUCH_S) + 1):
        time_ns = round(1e9 * frame / 30)
        image = camera.image(time_ns, frame)
        seen.append((frame / 30, reader.take(image, time_ns)))
        for at in SHOWN_S:
            if abs(frame / 30 - at) < 1 / 60:
                images[at] = image, seen[-1][1]
    figure = plt.figure(figsize=(11, 6.2), layout="constrained")
    top, bottom = figure.subfigures(2, 1)
    left = reader.exits[0]
    for axes, (at, (image, approach)) in zip(top.subplots(1, 3), images.items(), strict=True):
        axes.imshow(image, cmap="gray", vmin=0, vmax=200)
        place = np.array([approach.x_mm, approach.y_mm])
        for half, exits in enumerate(reader.exits):
            off = np.where(exits.valid, np.linalg.norm(exits.foot - place, axis=-1), np.inf)
            row, col = np.unravel_index(np.argmin(off), left.valid.shape)
            axes.plot(col + 160 * half, row, "+", color="#ff5d2e", ms=14, mew=2)
        axes.set_title(
            f"{TOUCH_S - at:.2f} s before: {approach.contact_s:.3f} ± {approach.sigma_contact_s:.3f} s",
            size=9,
        )
        axes.set_axis_off()
    known = [(t, one) for t, one in seen if one.armed]
    times = np.array([t for t, _ in known])
    height, contact = bottom.subplots(1, 2)
    path = camera.scenario.objects[0].points
    height.plot(times, [-place_at(path, round(1e9 * t))[2] for t in times], color="#999999", label="true")
    height.errorbar(
        times, [one.height_mm for _, one in known], [2 * one.sigma_height_mm for _, one in known],
        fmt=".", ms=3, color="#5b7fd9", label="read, two sigma",
    )  # fmt: skip
    height.set(xlabel="time, s", ylabel="height over the mirror, mm")
    height.legend()
    left_s = TOUCH_S - times
    percent = [
        100 * (one.contact_s / left - 1) for (_, one), left in zip(known, left_s, strict=True) if left > 0.02
    ]
    contact.plot(left_s[left_s > 0.02], percent, ".", color="#5b7fd9")
    contact.axhspan(-10, 10, color="#2e9e5b", alpha=0.12)
    contact.invert_xaxis()
    contact.set(xlabel="before the touch, s", ylabel="time to contact, error, %", ylim=(-25, 25))
    figure.savefig(file, dpi=110)


if __name__ == "__main__":
    main(sys.argv[1])
