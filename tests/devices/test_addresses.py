import pytest

from zeromethod import InputError, load_rig
from zeromethod.devices.addresses import camera_driver, with_camera, with_watch_camera

RIG = load_rig("simulated")


@pytest.mark.parametrize(
    ("address", "driver", "options"),
    [
        ("0", "opencv", {"source": 0}),
        ("12", "opencv", {"source": 12}),
        ("tcp://127.0.0.1:5000", "opencv", {"source": "tcp://127.0.0.1:5000"}),
        ("rtsp://me:pw@cam/1", "opencv", {"source": "rtsp://me:pw@cam/1"}),
        ("pylon", "pylon", {}),
        ("pylon:0815-0000", "pylon", {"serial": "0815-0000"}),
        ("aravis", "aravis", {}),
        ("aravis:192.168.0.7", "aravis", {"address": "192.168.0.7"}),
        ("aravis:fe80::1", "aravis", {"address": "fe80::1"}),
        ("my_lab.cameras:Ours", "my_lab.cameras:Ours", {}),
        ("simulated", "simulated", {}),
    ],
)
def test_an_address_names_a_driver_and_its_camera(address, driver, options):
    assert camera_driver(address) == (driver, options)


def test_a_file_is_opened_by_opencv_whatever_its_name(tmp_path):
    film = tmp_path / "a:b"
    film.touch()
    assert camera_driver(str(film)) == ("opencv", {"source": str(film)})


@pytest.mark.parametrize(
    "address", ["", "-1", "pylon:", "nothing.mp4", "tcp://", "1.5", "pylno", "a.b:", "a b:C"]
)
def test_anything_else_is_refused_with_what_is_allowed(address):
    with pytest.raises(InputError, match=r"^--camera: .*: allowed: an index \(0\), a URL .*pylon") as error:
        camera_driver(address)
    assert "\n" not in str(error.value)


def test_a_rig_gets_the_camera_and_keeps_its_optics():
    rig = with_camera(RIG, "pylon:17", {"gain": 3.0})
    assert (rig.camera.driver, rig.camera.model_extra, rig.camera.gain) == ("pylon", {"serial": "17"}, 3.0)
    assert rig.camera.focal_px == RIG.camera.focal_px
    assert RIG.camera.driver == "simulated"


def test_options_stay_with_their_driver():
    here = with_camera(RIG, "0", {"lost_after_s": 3.0})
    assert with_camera(here, "tcp://a:1").camera.model_extra == {"source": "tcp://a:1", "lost_after_s": 3.0}
    assert with_camera(here, "pylon").camera.model_extra == {}


def test_a_watch_camera_is_named_as_a_camera_is_and_keeps_its_pose():
    rig = load_rig("contactless")
    watch = with_watch_camera(rig, "pylon:3").watch
    assert (watch.driver, watch.model_extra) == ("pylon", {"serial": "3"})
    assert watch.position_mm == rig.watch.position_mm
    with pytest.raises(InputError, match=r"--watch-camera: '0': the rig has no table \[watch\]"):
        with_watch_camera(RIG, "0")
