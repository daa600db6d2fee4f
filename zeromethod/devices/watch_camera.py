"""Opening of the watch camera that a rig's `[watch]` table names."""

from __future__ import annotations

from collections.abc import Callable

from zeromethod.clock import Clock
from zeromethod.devices.opening import WrongShape, load_driver, open_camera
from zeromethod.devices.protocols import Camera
from zeromethod.errors import InputError
from zeromethod.rig.model import SIMULATED, Rig

TWO_LENSES = (
    "needed: the views of two lenses side by side in one frame, each half of [watch] columns; "
    "by one lens it cannot be known when something touches, nor how large it is"
)
SIMULATED_WATCH = "zeromethod.simulation.watch_camera:SimulatedWatchCamera"


def watch_opener(rig: Rig, clock: Clock) -> Callable[[], Camera]:
    """A function that opens the rig's watch camera on the run's clock.

    Raises InputError for unknown drivers, and if only one of camera and watch camera is simulated. The
    function raises InputError where the camera cannot be opened.
    """
    assert rig.watch is not None
    spec = rig.watch.camera()
    if (spec.driver == SIMULATED) != (rig.camera.driver == SIMULATED):
        raise InputError(
            f"watch.driver: {spec.driver!r}: camera and watch camera are both simulated, or both are real; "
            "allowed: --watch-camera together with --camera and --display"
        )
    factory = load_driver("camera", SIMULATED_WATCH if spec.driver == SIMULATED else spec.driver)

    def open_watch() -> Camera:
        try:
            return open_camera(spec, factory, {"rig": rig, "clock": clock})
        except InputError as error:
            more = f"; {TWO_LENSES}" if isinstance(error, WrongShape) else ""
            raise InputError(f"watch {error}{more}") from error

    return open_watch
