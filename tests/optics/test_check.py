"""Benches that cannot work are refused in one line that names the rig's key."""

import numpy as np
import pytest

from zeromethod import InputError, load_rig
from zeromethod.optics import check_geometry
from zeromethod.rig.model import Layer

from .optics_shapes import small


@pytest.mark.parametrize("name", ["simulated", "paper"])
def test_the_packaged_rigs_pass(name):
    check_geometry(load_rig(name))


def test_a_view_partly_off_the_mirror_passes():
    check_geometry(small(camera={"focal_px": (900.0, 900.0)}))


@pytest.mark.parametrize(
    ("parts", "key"),
    [
        ({"camera": {"position_mm": (38.0, 0.0, -20.0)}}, "camera.position_mm"),  # in the rubber
        ({"camera": {"position_mm": (-200.0, 0.0, -200.0)}}, "camera.position_mm"),  # the LCD's side
        ({"camera": {"position_mm": (38.0, 0.0, 200.0)}}, "camera.position_mm"),  # over the mirror
        ({"camera": {"look_at_mm": (275.0, 90.0, 0.0)}}, "camera.look_at_mm"),  # past the prism
        ({"camera": {"look_at_mm": (43.0, 0.0, -40.0), "focal_px": (9000.0, 9000.0)}}, "camera.look_at_mm"),
        ({"camera": {"look_at_mm": (277.1102, 50.0, -197.2809)}}, "camera.look_at_mm"),  # along y
        ({"display": {"tilt_deg": (0.0, 2.0)}}, "display.tilt_deg"),  # 30 mm x 2 deg > 0.5 mm of gap
        ({"display": {"centre_mm": (120.0, 0.0)}}, "display.centre_mm"),
        ({"display": {"rows": 100, "centre_mm": (30.0, 30.0)}}, "display.centre_mm"),
        # straight up to the mirror next to R0: thrown back at the camera face
        (
            {"camera": {"position_mm": (60.0, 0.0, -300.0), "look_at_mm": (70.0, 0.0, 0.0)}},
            "camera.position_mm",
        ),
    ],
)
def test_a_bench_that_cannot_see_is_refused(parts, key):
    with pytest.raises(InputError, match=key.replace(".", r"\.")) as refused:
        check_geometry(small(**parts))
    assert "\n" not in str(refused.value)


def test_a_camera_within_the_camera_layers_is_refused():
    plate = (Layer(index=1.49, thickness_mm=500.0),)
    with pytest.raises(InputError, match=r"camera\.position_mm"):
        check_geometry(small(camera_layers=plate))


def test_a_height_map_that_ends_within_the_view_is_refused(tmp_path):
    np.save(tmp_path / "rest.npy", np.zeros((20, 20)))
    rest = small().prism.rest.model_copy(
        update={"shape": "map", "file": tmp_path / "rest.npy", "pitch_mm": 2.0, "origin_mm": (0.0, -20.0)}
    )
    with pytest.raises(InputError, match=r"prism\.rest\.file.*covers x 0 to 38 mm"):
        check_geometry(small(prism={"rest": rest}))
