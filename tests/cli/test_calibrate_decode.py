"""`zeromethod calibrate decode` as a person meets it: files of every kind, figures, refusals."""

import json
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


def outcome(*arguments: object, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as end:
        command_line.main(["calibrate", "decode", *(str(argument) for argument in arguments)])
    printed = capsys.readouterr()
    return int(end.value.code or 0), printed.out, printed.err


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


def test_images_give_the_rest_map_and_the_figures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    paths = images(tmp_path, capture(SEQUENCE))
    output, summary = tmp_path / "rest.npz", tmp_path / "rest.json"
    code, out, err = outcome(
        *paths, *BASIC, "--panel", *PANEL, "--output", output, "--summary", summary, capsys=capsys
    )
    assert (code, err) == (0, "")
    assert "camera pixels left out: no modulation" in out
    rest = check(output)
    with np.load(output) as data:
        assert set(data.files) == {"column", "row", "sigma", "valid", "reason"}
        assert data["column"].shape == data["row"].shape == data["valid"].shape == SHAPE
    told = json.loads(summary.read_text())
    assert told["valid_share"] == pytest.approx(rest.valid.mean())
    assert told["reasons_px"]["no modulation"] == np.sum((rest.reason & Reason.NO_MODULATION) != 0)
    assert told["display_px"] == list(PANEL)
    assert told["wrong_orders_expected"] < 1e-12


@pytest.mark.parametrize("kind", ["tif", "pages", "npy", "npz", "float", "mixed"])
def test_every_kind_of_file_gives_the_same_map(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames = capture(SEQUENCE, bits=12)
    if kind == "tif":
        paths = images(tmp_path, frames, ".tif")
    elif kind == "pages":
        paths = [tmp_path / "stack.tif"]
        cv2.imwritemulti(str(paths[0]), frames)
    elif kind == "npz":
        paths = [tmp_path / "stack.npz"]
        np.savez(paths[0], columns=np.stack(frames[:24]), rows=np.stack(frames[24:]))
    elif kind == "mixed":
        paths = [tmp_path / "columns.npy", *images(tmp_path, frames[24:])]
        np.save(paths[0], np.stack(frames[:24]))
    else:
        paths = [tmp_path / "stack.npy"]
        stack = np.stack(frames)
        np.save(paths[0], stack.astype(np.float32) if kind == "float" else stack)
    output = tmp_path / "rest.npz"
    code, _, err = outcome(*paths, *BASIC, "--panel", *PANEL, "--bits", 12, "--output", output, capsys=capsys)
    assert (code, err) == (0, "")
    check(output)


def test_unequal_shifts_other_axes_and_repeats(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    degrees = (0, 50, 130, 170, 220, 300)
    sequence = FringeSequence(PERIODS, tuple(np.deg2rad(degrees)), ("rows", "columns"), 2)
    stack, output = tmp_path / "stack.npy", tmp_path / "rest.npz"
    np.save(stack, np.stack(capture(sequence)))
    code, _, err = outcome(
        stack, "--periods", "16,18,19,23", "--shifts", ",".join(map(str, degrees)), "--axes", "rows,columns",
        "--repeats", 2, "--noise", 1.275, 1e6, "--output", output, capsys=capsys,
    )  # fmt: skip
    assert (code, err) == (0, "")
    check(output)


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
def test_wrong_options_end_with_one_line(
    change: tuple[str, str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = images(tmp_path, [np.zeros(SHAPE, np.uint8)] * SEQUENCE.frames)
    options = {"--periods": "16,18,19,23", "--shifts": "6", "--output": str(tmp_path / "rest.npz")}
    options[change[0]] = change[1]
    code, _, err = outcome(*paths, *(word for pair in options.items() for word in pair), capsys=capsys)
    assert code == 2
    assert words in err
    assert err.count("\n") == 1
    assert not (tmp_path / "rest.npz").exists()


@pytest.mark.parametrize(
    "fault", ["missing", "text", "empty", "size", "text.npy", "words.npy", "flat.npy", "torn.npz"]
)
def test_wrong_files_end_with_one_line(
    fault: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = images(tmp_path, capture(SEQUENCE))
    bad = tmp_path / (fault if "." in fault else "frame005.png")
    if fault == "missing":
        bad.unlink()
    elif fault in ("text", "empty"):
        bad.write_text("no picture" if fault == "text" else "")
    elif fault == "size":
        cv2.imencode(".png", np.zeros((10, 12), np.uint8))[1].tofile(bad)
    elif fault == "words.npy":
        np.save(bad, np.array(["a", "b"]))
    elif fault == "flat.npy":
        np.save(bad, np.zeros(7))
    else:
        bad.write_bytes(b"PK\x03\x04 and no more" if fault == "torn.npz" else b"no array")
    paths[5] = bad
    code, _, err = outcome(*paths, *BASIC, "--output", tmp_path / "rest.npz", capsys=capsys)
    assert code == 2
    assert bad.name in err
    assert err.count("\n") == 1
    assert not (tmp_path / "rest.npz").exists()


@pytest.mark.parametrize(("grey", "why"), [(0, "no modulation"), (255, "no modulation")])
def test_a_black_or_blinded_camera_fails_with_the_reason(
    grey: int, why: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stack = tmp_path / "stack.npy"
    np.save(stack, np.full((SEQUENCE.frames, *SHAPE), grey, np.uint8))
    code, out, err = outcome(stack, *BASIC, "--output", tmp_path / "rest.npz", capsys=capsys)
    assert code == 1
    assert f"{why} at 100%" in err
    assert ("saturated" in out) == (grey == 255)


def test_a_view_without_fringes_fails_with_the_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stack = tmp_path / "stack.npy"
    np.save(stack, np.random.default_rng(0).integers(90, 110, (SEQUENCE.frames, *SHAPE)).astype(np.uint8))
    code, _, err = outcome(stack, *BASIC, "--output", tmp_path / "rest.npz", capsys=capsys)
    assert code == 1
    assert "no camera pixel has a place on the LCD: no modulation at 100%" in err
    # The map is written all the same: it says why, pixel by pixel.
    assert not RestMap.load(tmp_path / "rest.npz").valid.any()
