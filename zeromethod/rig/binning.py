"""The same rig with fewer, larger camera pixels: for quick runs and tests."""

from __future__ import annotations

from zeromethod.errors import InputError
from zeromethod.rig.model import Rig, check_rig

_SMALLEST_PX = 64
_PERIODS = 4


def binned(rig: Rig, factor: int) -> Rig:
    """Rig whose camera has `factor` times fewer pixels on each axis over the same view.

    The target's period, the blur and the noise stay the same in (larger) pixels, so nodes lie `factor`
    times further apart on the mirror. A rest map and marks, which are of the whole pixels, are left
    out.

    Parameters
    ----------
    rig : Rig
        The bench.
    factor : int
        How many pixels become one, on each axis.

    Returns
    -------
    Rig
        The same bench with the larger pixels.

    Raises
    ------
    InputError
        `factor` does not divide both axes, or leaves fewer pixels than a camera must have (64, and four
        periods of the target).
    """
    check_rig("binned", rig)
    camera = rig.camera
    if type(factor) is not int or factor < 1 or camera.columns % factor or camera.rows % factor:
        raise InputError(
            f"binning: {factor!r}: a whole number that divides {camera.columns} and {camera.rows} camera px"
        )
    smallest = max(_SMALLEST_PX, _PERIODS * rig.target.period_px)
    if min(camera.columns, camera.rows) // factor < smallest:
        raise InputError(f"binning: {factor}: one that leaves at least {smallest} camera px on each axis")
    scale = {
        "columns": camera.columns // factor,
        "rows": camera.rows // factor,
        "centre_px": tuple((c + 0.5) / factor - 0.5 for c in camera.centre_px),
        "focal_px": camera.focal_px and tuple(f / factor for f in camera.focal_px),
        "pixel_mm": camera.pixel_mm and camera.pixel_mm * factor,
    }
    if camera.rest_map is not None and factor > 1:
        scale["rest_map"] = None
    surface = rig.surface.model_copy(update={"marks_px": ()}) if factor > 1 else rig.surface
    return rig.model_copy(update={"camera": camera.model_copy(update=scale), "surface": surface})
