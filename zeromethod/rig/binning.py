"""The same bench seen with fewer, larger camera pixels: for quick looks and quick tests."""

from __future__ import annotations

from zeromethod.rig.model import Rig


def binned(rig: Rig, factor: int) -> Rig:
    """Rig whose camera has `factor` times fewer pixels on each axis over the same view.

    The target's period stays the same in (larger) pixels, so nodes lie `factor` times further apart on
    the mirror.
    """
    camera = rig.camera
    scale = {
        "columns": camera.columns // factor,
        "rows": camera.rows // factor,
        "centre_px": tuple((c + 0.5) / factor - 0.5 for c in camera.centre_px),
        "focal_px": camera.focal_px and tuple(f / factor for f in camera.focal_px),
        "pixel_mm": camera.pixel_mm and camera.pixel_mm * factor,
    }
    return rig.model_copy(update={"camera": camera.model_copy(update=scale)})
