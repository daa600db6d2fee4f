"""The simulated bench that a real one becomes: same geometry, timing and noise, other devices."""

from __future__ import annotations

from zeromethod.rig.model import SIMULATED, Rig

_OF_THE_DEVICE = frozenset({"driver", "gain", "pixel_format", "region_px", "trigger", "rest_map"})
"""Keys of `[camera]` that a real device is set to, or that were measured of it beyond the geometry."""


def simulated_clone(rig: Rig) -> Rig:
    """Rig with simulated display and camera in place of its own. A simulated rig comes back as it is.

    Everything about geometry, panel, response, noise, target, control and surface stays; what is not known of
    the geometry goes, as the clone's is exact. The drivers' own options and what only a device can be set to
    go. The delay that was measured is kept whole: the display's latency stays, and the camera's becomes that
    of the simulated one unless `[simulation]` gives it. A display latency below zero (stamps that come too
    early) no panel can have: it becomes 0 and is taken off the camera's, which leaves the time from
    presentation to frame in hand what it was.

    The clone's light is `[simulation]`'s: exposure and gain of the real camera are taken to be set so that
    white comes to its `peak_grey_share`.
    """
    if rig.display.driver == SIMULATED and rig.camera.driver == SIMULATED:
        return rig
    early_s = min(rig.display.latency_s, 0.0)
    display = rig.display.given()
    display.pop("latency_range_s", None)
    camera = {key: value for key, value in rig.camera.given().items() if key not in _OF_THE_DEVICE}
    if early_s < 0.0:
        display["latency_s"] = 0.0
        camera["latency_s"] = max(rig.camera.latency_s + early_s, 0.0)
    clone = rig.replace(
        display=display | {"driver": SIMULATED}, camera=camera | {"driver": SIMULATED}, geometry=None
    )
    if clone.watch is not None:
        watch = {key: value for key, value in clone.watch.given().items() if key not in _OF_THE_DEVICE}
        clone = clone.replace(watch=watch | {"driver": SIMULATED})
    if clone.projector is not None and clone.projector.driver != SIMULATED:
        cloth = {} if clone.cloth is None else clone.cloth.given()
        clone = clone.replace({"projector.driver": SIMULATED, "projector.monitor": None}, cloth=cloth)
    if "camera_latency_s" in rig.simulation.model_fields_set:
        return clone
    return clone.replace({"simulation.camera_latency_s": clone.camera.latency_s})
