"""Draws docs/lighting.png: what the camera sees under each light while a pad presses, and the error of depth.

Run in the repository: python tools/lighting_picture.py docs/lighting.png
"""

import sys

import numpy as np
from matplotlib.figure import Figure

from benchmarks.lightings import CASES, DEPTH_MM, GOOD, LAST_S, PRINT, exposed, pad, rig_of

FACTOR = 2
SHOWN_NM = 300.0
TITLES = {PRINT: "print, lamp"}


def main(path: str) -> None:
    """Run the stronger of each lighting and draw the last frame called good."""
    strongest = {light: (strength, values) for light, strength, values in CASES if strength}
    figure = Figure(figsize=(16, 4.6), layout="constrained")
    axes = figure.subplots(2, len(strongest))
    for column, (light, (strength, values)) in enumerate(strongest.items()):
        rig = rig_of(light, values, FACTOR)
        with pad(rig, 0.3) as bench, exposed(bench, rig.camera.exposure_s) as session:
            truth = session.result.true_mirror
            assert truth is not None
            for step in session.run(seconds=LAST_S if light == "ring light" else 0.7):
                if step.image is None or step.surface is None or step.state not in GOOD:
                    continue
                image, surface, time_ns = step.image, step.surface, step.time_ns
        off = 1e6 * (surface.depth_mm - truth(time_ns).depth(surface.x_mm, surface.y_mm))
        off[~surface.valid] = np.nan
        seen, error = axes[:, column]
        seen.imshow(image, cmap="gray", vmin=0, vmax=2**rig.camera.bits - 1)
        seen.set_title(f"{TITLES.get(light, light)} {strength}", fontsize=10)
        shown = error.imshow(off[2:-2, 2:-2], cmap="RdBu_r", vmin=-SHOWN_NM, vmax=SHOWN_NM)
        error.set_facecolor("0.6")
        for each in (seen, error):
            each.set_xticks([])
            each.set_yticks([])
    axes[0, 0].set_ylabel("camera")
    axes[1, 0].set_ylabel("depth less the true one")
    figure.colorbar(shown, ax=axes[1, :].tolist(), label="nm", shrink=0.8)
    figure.suptitle(
        f"A pad presses {DEPTH_MM:g} mm deep under eight lightings; grey: not called good", fontsize=11
    )
    figure.savefig(path, dpi=90)


if __name__ == "__main__":
    main(sys.argv[1])
