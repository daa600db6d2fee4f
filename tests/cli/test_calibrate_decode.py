"""`zeromethod calibrate decode` as a person meets it: files of every kind, figures, refusals."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from zeromethod.cli import main as command_line
from zeromethod.decoding import Reason
from zeromethod.decoding.fringes import FringeSequence, equal_shifts
from zeromethod.warp.rest_map import RestMap

PERIODS = (16.0, 18.0, 19.0, 23.0)
SHAPE = (48, 64)
PANEL = (200, 160)


Decode = Callable[..., tuple[int, str, str]]


@pytest.fixture
def decode(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Decode:
    """Exit code, output and errors of the command, which writes rest.npz."""

    def run(*arguments: object) -> tuple[int, str, str]:
        words = ["calibrate", "decode", "--output", tmp_path / "rest.npz", *arguments]
        with pytest.raises(SystemExit) as end:
            command_line.main([str(word) for word in words])
        printed = capsys.readouterr()
        return int(end.value.code or 0), printed.out, printed.err

    return run


def true_map() -> np.ndarray:
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    return np.stack([20 + 1.2 * u + 0.1 * v, 30 + 1.1 * v - 0.002 * u * u], axis=-1)


def capture(sequence: FringeSequence, bits: int = 8, seed: int = 0) -> list[np.ndarray]:
    """Frames with a noise of one 200th of full scale; the left eight columns are not mirror."""
    rng = np.random.default_rng(seed)
    full = 2**bits - 1
    frames = []
    for fringes in sequence.sets():
        x = true_map()[..., 0 if fringes.axis == "columns" else 1]
        for shift in sequence.shifts_rad:
            light = 0.4 + 0.3 * np.cos(2 * np.pi * x / sequence.periods_px[fringes.period] - shift)
            light[:, :8] = 0.1
            grey = np.rint(full * (light + 0.005 * rng.normal(size=SHAPE)))
            frames.append(np.clip(grey, 0, full).astype(np.uint8 if bits == 8 else np.uint16))
    return frames


def images(folder: Path, frames: list[np.ndarray], suffix: str = ".png") -> list[Path]:
    paths = [folder / f"frame{n:03d}{suffix}" for n in range(len(frames))]
    for path, frame in zip(paths, frames, strict=True):
        cv2.imencode(suffix, frame)[1].tofile(path)
    return paths


def check(path: Path, sigma: float = 0.02) -> RestMap:
    rest = RestMap.load(path)
    assert not rest.valid[:, :8].any()
    assert rest.valid[:, 10:].all()
    off = (rest.lcd_px - true_map())[rest.valid]
    # Amplitude 0.3, noise 0.005: 0.0096 rad for six shifts and four periods of 16 to 23 px: 0.015 px.
    assert off.std() < sigma
    assert np.std(off / rest.sigma_px[rest.valid]) == pytest.approx(1.0, abs=0.06)
    return rest


BASIC = ("--periods", "16,18,19,23", "--shifts", "6")
SEQUENCE = FringeSequence(PERIODS, equal_shifts(6))


def test_images_give_the_rest_map_and_the_figures(decode, tmp_path):
    paths, summary = images(tmp_path, capture(SEQUENCE)), tmp_path / "rest.json"
    code, out, err = decode(*paths, *BASIC, "--panel", *PANEL, "--summary", summary)
    assert (code, err) == (0, "")
    assert "camera pixels left out: no modulation" in out
    rest = check(tmp_path / "rest.npz")
    with np.load(tmp_path / "rest.npz") as data:
        assert set(data.files) == {"column", "row", "sigma", "valid", "reason"}
        assert data["column"].shape == data["row"].shape == data["valid"].shape == SHAPE
    figures = json.loads(summary.read_text())
    assert figures["valid_share"] == pytest.approx(rest.valid.mean())
    assert figures["reasons_px"]["no modulation"] == np.sum((rest.reason & Reason.NO_MODULATION) != 0)
    assert figures["display_px"] == list(PANEL)
    assert figures["wrong_orders_expected"] < 1e-12


@pytest.mark.parametrize("kind", ["tif", "pages", "npy", "npz", "float", "mixed"])
def test_every_kind_of_file_gives_the_same_map(kind, decode, tmp_path):
    frames = capture(SEQUENCE, bits=12)
    stack, path = np.stack(frames), tmp_path / f"stack.{kind}"
    paths = [path.with_suffix(".tif" if kind == "pages" else ".npz" if kind == "npz" else ".npy")]
    if kind == "tif":
        paths = images(tmp_path, frames, ".tif")
    elif kind == "pages":
        cv2.imwritemulti(str(paths[0]), frames)
    elif kind == "npz":
        np.savez(paths[0], columns=stack[:24], rows=stack[24:])
    elif kind == "mixed":
        np.save(paths[0], stack[:24])
        paths += images(tmp_path, frames[24:])
    else:
        np.save(paths[0], stack.astype(np.float32) if kind == "float" else stack)
    code, _, err = decode(*paths, *BASIC, "--panel", *PANEL, "--bits", 12)
    assert (code, err) == (0, "")
    check(tmp_path / "rest.npz")


def test_unequal_shifts_other_axes_and_repeats(decode, tmp_path):
    degrees = (0, 50, 130, 170, 220, 300)
    sequence = FringeSequence(PERIODS, tuple(np.deg2rad(degrees)), ("rows", "columns"), 2)
    np.save(tmp_path / "stack.npy", np.stack(capture(sequence)))
    options = ("--shifts", ",".join(map(str, degrees)), "--axes", "rows,columns", "--repeats", 2)
    code, _, err = decode(tmp_path / "stack.npy", *BASIC[:2], *options, "--noise", 1.275, 1e6)
    assert (code, err) == (0, "")
    check(tmp_path / "rest.npz")


def assert_one_line(outcome: tuple[int, str, str], words: str, folder: Path) -> None:
    code, _, err = outcome
    assert code == 2
    assert words in err
    assert err.count("\n") == 1
    assert not (folder / "rest.npz").exists()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("--periods", "16,x"), "--periods: 16,x: numbers"),
        (("--periods", "16,16"), "periods: 16,16: each period once"),
        (("--periods", "9,64,127,128"), "panel: size not given: these periods"),
        (("--shifts", "2"), "--shifts: 2: a count"),
        (("--shifts", "0,0,90"), "shifts: 0,0,90 degrees: three or more"),
        (("--shifts", "5"), "FRAMES: 48 in 48 files: 2 axes x 4 periods x 5 shifts = 40"),
        (("--repeats", "2"), "2 repeats x 2 axes x 4 periods x 6 shifts = 96"),
        (("--output", "rest.png"), "must end in .npz"),
        (("--rig", "virtual"), "64 x 48 px: the rig's camera has 640 x 512"),
        (("--rig", "nowhere.toml"), "nowhere.toml"),
    ],
)
def test_wrong_options_end_with_one_line(change, words, decode, tmp_path):
    paths = images(tmp_path, [np.zeros(SHAPE, np.uint8)] * SEQUENCE.frames)
    assert_one_line(decode(*paths, *BASIC, *change), words, tmp_path)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("frame005.png", None),
        ("frame005.png", b"no picture"),
        ("frame005.png", b""),
        ("frame005.png", np.zeros((10, 12), np.uint8)),
        ("text.npy", b"no array"),
        ("words.npy", np.array(["a", "b"])),
        ("flat.npy", np.zeros(7)),
        ("torn.npz", b"PK\x03\x04 and no more"),
    ],
)
def test_wrong_files_end_with_one_line(name, content, decode, tmp_path):
    paths = images(tmp_path, capture(SEQUENCE))
    bad = paths[5] = tmp_path / name
    if isinstance(content, bytes):
        bad.write_bytes(content)
    elif content is None:
        bad.unlink()
    elif bad.suffix == ".png":
        cv2.imencode(".png", content)[1].tofile(bad)
    else:
        np.save(bad, content)
    assert_one_line(decode(*paths, *BASIC), bad.name, tmp_path)


NOISE = np.random.default_rng(0).integers(90, 110, (SEQUENCE.frames, *SHAPE)).astype(np.uint8)


@pytest.mark.parametrize(
    ("frames", "saturated"), [(0 * NOISE, False), (0 * NOISE + 255, True), (NOISE, False)]
)
def test_a_camera_that_sees_no_fringes_fails_with_the_reason(frames, saturated, decode, tmp_path):
    np.save(tmp_path / "stack.npy", frames)
    code, out, err = decode(tmp_path / "stack.npy", *BASIC)
    assert code == 1
    assert "no camera pixel has a place on the LCD: no modulation at 100%" in err
    assert ("saturated" in out) == saturated
    # The map is written all the same: it says why, pixel by pixel.
    assert not RestMap.load(tmp_path / "rest.npz").valid.any()
