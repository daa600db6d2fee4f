"""`zeromethod calibrate fringes`: pictures that `calibrate decode` reads back."""

import resource
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from command_line import run

from zeromethod.decoding.fringes import CONTRAST, FringeSequence, equal_shifts
from zeromethod.pattern.response import Response
from zeromethod.rig.load import load_rig
from zeromethod.warp.rest_map import RestMap

OPTIONS = "--periods 16,20,22,25/16,19,23 --shifts 6 --axes rows,columns"


def test_the_pictures_read_back_give_every_pixel_its_own_number(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    outcome = run(f"calibrate fringes {OPTIONS} --panel 160 96 --output fringes")
    assert (outcome.code, outcome.err) == (0, "")
    assert "42 pictures of 160 x 96 px in fringes" in outcome.out
    names = " ".join(str(path) for path in sorted(Path("fringes").iterdir()))
    outcome = run(f"calibrate decode {names} {OPTIONS} --panel 160 96 --output rest.npz")
    assert (outcome.code, outcome.err) == (0, "")
    rest = RestMap.load(Path("rest.npz"))
    off = rest.lcd_px - np.stack(np.meshgrid(np.arange(160), np.arange(96)), axis=-1)
    assert rest.valid.all()
    # Grey levels are rounded by half a level at most: six of them turn a phase of amplitude 115 by
    # 2/6 * 1/2 * sum |cos| / 115 = 0.0058 rad at most, 25 px long by 0.023 px.
    assert np.abs(off).max() < 0.023
    # Rounding is no Gaussian noise: bounded, and the same again where all periods meet.
    assert np.mean(np.abs(off) < 3 * rest.sigma_px) > 0.99


def test_the_light_on_a_rigs_lcd_is_a_sine(tmp_path):
    outcome = run(f"calibrate fringes --periods 16,20 --shifts 3 --rig virtual --output {tmp_path}")
    assert (outcome.code, outcome.err) == (0, "")
    display = load_rig("virtual").display
    sequence = FringeSequence((16.0, 20.0), equal_shifts(3))
    pictures = sorted(tmp_path.iterdir())
    assert [path.name for path in pictures[:2]] == ["fringe00.png", "fringe01.png"]
    assert len(pictures) == sequence.frames
    for path, light in zip(pictures, sequence.pictures(display.columns, display.rows), strict=True):
        codes = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        shown = Response.from_rig(display).light(codes)
        # Half a grey level, where light is steepest in the code: gamma / 255.
        assert np.abs(shown - light).max() < 0.5 * max(display.gamma, 1.0) / 255
        assert np.ptp(shown) == pytest.approx(CONTRAST, abs=0.02)


@pytest.fixture
def tiny_files() -> Iterator[None]:
    """No file may be larger than 64 bytes, less than any picture: to what writes one, the disk is full."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (64, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.usefixtures("tiny_files")
@pytest.mark.parametrize(
    "command",
    [
        "calibrate fringes --periods 16,20 --shifts 3 --panel 160 96 --output fringes",
        "calibrate board --board 5x4:10 --dpi 50 --output board.png",
    ],
)
def test_a_disk_that_takes_no_picture_is_named_with_the_option(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    code, _, err = run(command)
    assert code == 2
    assert err.startswith("zeromethod: --output: ")
    assert "cannot be written: " in err
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]
