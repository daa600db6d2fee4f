"""A planted motion of the bench: where camera and LCD truly are, frame by frame."""

from __future__ import annotations

import numpy as np

from zeromethod.rig.model import Rig


def moved_share(rig: Rig, frame: int) -> float:
    """How much of the planted motion has been made by a frame, 0 to 1."""
    faults = rig.simulation.faults
    if faults.moved_at_frame is None or frame < faults.moved_at_frame:
        return 0.0
    return min((frame - faults.moved_at_frame + 1) / (faults.moved_over_frames + 1), 1.0)


def moved_rig(rig: Rig, share: float) -> Rig:
    """The bench as it truly is after a share of its planted motion."""
    camera, display, faults = rig.camera, rig.display, rig.simulation.faults
    pan, tilt, roll = share * np.radians(faults.camera_turned_deg)
    view = np.subtract(camera.look_at_mm, camera.position_mm)
    axis = view / np.linalg.norm(view)
    v_axis = np.array([0.0, 1.0, 0.0]) - axis[1] * axis
    v_axis /= np.linalg.norm(v_axis)
    u_axis = np.cross(v_axis, axis)
    # a right-handed turn about v takes the line of sight towards u, one about u away from v
    aim = axis + np.tan(pan) * u_axis - np.tan(tilt) * v_axis
    look_at = np.add(camera.position_mm, np.linalg.norm(view) * aim / np.linalg.norm(aim))
    slid = np.add(display.centre_mm, share * np.array(faults.display_slid_mm))
    return rig.model_copy(
        update={
            "camera": camera.model_copy(
                update={
                    "look_at_mm": tuple(map(float, look_at)),
                    "roll_deg": camera.roll_deg + float(np.degrees(roll)),
                }
            ),
            "display": display.model_copy(update={"centre_mm": tuple(map(float, slid))}),
        }
    )
