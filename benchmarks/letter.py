"""A small letter, 0.5 um deep with strokes of 0.4 mm, by nodes and pixels, by the null and by open loops.

All from the same number of frames of the simulated bench with a pupil of 2.5 mm: the nodes of one frame, and
the fine surface of the last frames, once with the loop closed and once with the picture of the mirror at
rest.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import click
import cv2
import matplotlib as mpl
import numpy as np

from benchmarks.every_pixel.scenes import OPEN_GAIN, Held, bench_rig, held
from benchmarks.report import start
from benchmarks.rigs import VIEW_MIDDLE_MM
from zeromethod.arrays import Float
from zeromethod.surface import SurfaceReader

DEPTH_MM, STROKE_MM, BLUR_MM, PITCH_MM, SIDE = 5e-4, 0.4, 0.12, 0.025, 241
_LINES = (((-1.0, -1.5), (-1.0, 1.5)), ((-1.0, -1.5), (1.0, -1.5)), ((-1.0, 0.0), (0.6, 0.0)))


def letter() -> Float:
    """(SIDE, SIDE) depth of an F over its largest, rows along y."""
    image, middle = np.zeros((SIDE, SIDE), np.uint8), SIDE // 2
    for ends in _LINES:
        a, b = ([round(middle + value / PITCH_MM) for value in end] for end in ends)
        cv2.line(image, a, b, 255, round(STROKE_MM / PITCH_MM))
    blurred = cv2.GaussianBlur(image.astype(np.float64), (0, 0), BLUR_MM / PITCH_MM)
    return np.asarray(blurred / blurred.max())


def seen(gain: float, shape: Float) -> Held:
    """What the bench saw of the letter."""
    with tempfile.TemporaryDirectory() as folder:
        np.save(Path(folder) / "letter.npy", shape)
        path = f"[{{time_s=0.0,x_mm={VIEW_MIDDLE_MM},y_mm=0.0,depth_mm={DEPTH_MM}}}]"
        press = Path(folder) / "letter.toml"
        text = f'[[press]]\nshape="map"\nfile="letter.npy"\npitch_mm={PITCH_MM}\npath={path}\n'
        press.write_text(text)
        return held(bench_rig(0, gain=gain).model_copy(update={"scenario": str(press)}))


@click.command("letter", help=__doc__)
@click.option("--output", type=click.Path(path_type=Path), default=Path("docs/letter.png"))
def command(output: Path) -> None:
    """Run both benches and draw."""
    mpl.use("agg")
    import matplotlib.pyplot as plt  # noqa: PLC0415

    shape = letter()
    side = PITCH_MM * (np.arange(SIDE) - SIDE // 2)
    panels: list[tuple[str, Any, Any, Any]] = [
        ("the mirror", VIEW_MIDDLE_MM + side, side, 1e3 * DEPTH_MM * shape)
    ]
    for gain, name in ((1.0, "null"), (OPEN_GAIN, "open loop")):
        one = seen(gain, shape)
        nodes = SurfaceReader(one.rig, one.optics, one.grid).read(one.frames[-1].measured)
        fine = one.read()
        for what, read in (("nodes, one frame", nodes), ("every pixel", fine)):
            x, y, depth = read.x_mm, read.y_mm, 1e3 * read.depth_mm
            true = 1e3 * one.mirror.depth(x.astype(float), y.astype(float))
            known = np.isfinite(depth)
            error_nm = 1e3 * float(np.sqrt(np.mean((depth - true)[known] ** 2)))
            panels.append((f"{name}: {what}\nerror {error_nm:.1f} nm rms", x, y, depth))
    figure, axes = plt.subplots(1, len(panels), figsize=(15, 3.6), constrained_layout=True)
    for axis, (title, x, y, depth) in zip(axes, panels, strict=True):
        drawn = axis.pcolormesh(x, y, depth, cmap="viridis", vmin=-0.05, vmax=0.5, shading="nearest")
        axis.set(title=title, xlim=(39.0, 45.0), ylim=(2.5, -2.5), xlabel="x, mm", aspect="equal")
    figure.colorbar(drawn, ax=axes, label="depth, µm", shrink=0.8)
    figure.savefig(output, dpi=110)
    click.echo(f"{output}: " + "; ".join(title.replace("\n", ", ") for title, *_ in panels[1:]))


if __name__ == "__main__":
    start(command)
