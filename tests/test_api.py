"""`import zeromethod as zm`: fast, complete, documented, and doing what the commands do."""

from __future__ import annotations

import json
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import matplotlib as mpl
import numpy as np
import pytest
from recorded_run import recorded, small_rig

import zeromethod as zm
from benchmarks.rigs import coarser
from zeromethod.cli.main import _COMMANDS
from zeromethod.decoding.fringes import FringeSequence
from zeromethod.study import Workers, workers

ROOT = Path(__file__).parent.parent
HEAVY = ("numpy", "scipy", "cv2", "numba", "h5py", "matplotlib", "pydantic", "moderngl")


def test_importing_the_package_loads_nothing_heavy() -> None:
    code = f"import sys, zeromethod; print([name for name in {HEAVY} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "[]"


def test_every_name_is_there_and_listed() -> None:
    assert set(zm.__all__) == {*dir(zm), "__version__"}
    for name in zm.__all__:
        assert getattr(zm, name).__doc__, name
    with pytest.raises(AttributeError, match="sessoin"):
        zm.sessoin  # type: ignore[attr-defined] # noqa: B018


FUNCTIONS = {
    "run": zm.run,
    "report": zm.report,
    "replay": zm.replay,
    "export": zm.export_recording,
    "study": zm.run_study,
    "devices": zm.cameras,
    "init": zm.rig_text,
    "calibrate": zm.calibrate,
    "check": zm.check_bench,
    "design": zm.assess_rig,
    "measure": zm.measure,
    "reproduce": zm.reproduce,
}


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: zm.plot(None), "plot: surface: NoneType: a Surface"),
        (lambda: zm.peak(None), "peak: surface: NoneType: a Surface"),
        (lambda: zm.plot_run([]), "plot_run: run: list: a Session, or its result"),
        (lambda: zm.summarise(None), "summarise: result: NoneType: the result of a session"),
        (lambda: zm.open_devices("simulated"), "open_devices: rig: str: a Rig, as load_rig gives it"),
        (lambda: zm.Optics(None), "Optics: rig: NoneType: a Rig"),
        (lambda: zm.binned("simulated", 2), "binned: rig: str: a Rig"),
        (lambda: zm.load_rig(None), "rig: NoneType: a file, or one of the packaged"),
        (lambda: zm.open_recording(None), "recording: NoneType: a file"),
        (lambda: zm.run_study(3), "study: int: a Study"),
    ],
)
def test_an_argument_of_another_type_is_refused_in_one_line(call, words: str) -> None:
    with pytest.raises(zm.InputError, match=f"^{words}") as refused:
        call()
    assert "\n" not in str(refused.value)


def test_every_command_has_its_function():
    # the virtual bench is another process by nature: it takes the place of prism and camera
    assert set(FUNCTIONS) | {"virtual-bench", "compile"} == set(_COMMANDS)


def test_the_reference_is_that_of_the_docstrings() -> None:
    tool = runpy.run_path(str(ROOT / "tools" / "api_reference.py"))
    hint = "python tools/api_reference.py > docs/api.md brings it up to date"
    assert (ROOT / "docs" / "api.md").read_text() == tool["reference"](), hint


def test_the_notebook_runs(capsys, monkeypatch):
    # with a fourth of the LCD's pixels on each axis too, for speed
    monkeypatch.setattr(zm, "binned", coarser, raising=False)
    path = ROOT / "examples" / "first_press.ipynb"
    cells = json.loads(path.read_text())["cells"]
    assert not any(cell.get("outputs") for cell in cells)
    mpl.use("agg")
    values: dict[str, object] = {}
    for cell in cells:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), str(path), "exec"), values)
    lines = capsys.readouterr().out.splitlines()
    assert sum("locked" in line for line in lines) == 4
    assert lines[-1].endswith(" mm")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("api") / "run.h5", 0.3, rig=small_rig("hold"))


def test_a_surface_is_plotted_and_saved(recording: Path, tmp_path: Path) -> None:
    with zm.open_recording(recording) as opened:
        surface = opened.surface(int(opened.peaks["step"][-1]))
    assert surface is not None
    figure = zm.plot(surface, tmp_path / "surface.png")
    labels = [axis.get_ylabel() for axis in figure.axes]
    assert {"mm", "nm", "mrad"} <= set(labels)
    assert cv2.imread(str(tmp_path / "surface.png")) is not None
    assert "peak 0." in figure.get_suptitle()


def test_a_recording_is_replayed_exported_and_reported(recording: Path, tmp_path: Path) -> None:
    again = zm.replay(recording)
    assert again["equal"]
    assert not again["changed"]
    assert zm.replay(recording, "from-frames")["equal"]
    assert zm.replay(recording, settings=["control.gain=0.5"])["changed"]
    assert zm.export_recording(recording, tmp_path / "peak.csv")["peaks"] > 5
    assert zm.report(recording, tmp_path / "page.html")["frames"] > 5
    assert "<html" in (tmp_path / "page.html").read_text()
    with pytest.raises(zm.InputError, match="form: 'xls'"):
        zm.export_recording(recording, tmp_path / "x", form="xls")
    with pytest.raises(zm.InputError, match="mode: 'dream'"):
        zm.replay(recording, "dream")  # type: ignore[arg-type]


def test_images_are_measured_as_arrays_and_as_files(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    texture = cv2.GaussianBlur(rng.uniform(0, 255, (160, 200)), (0, 0), 2.0)
    texture = np.uint8(255 * (texture - texture.min()) / np.ptp(texture))
    moved = np.roll(texture, 3, axis=1)
    reading = zm.measure(texture, moved)
    found = reading.displacement
    assert np.median(found.du[found.valid]) == pytest.approx(3.0, abs=0.02)
    assert reading.surface is None
    for name, image in (("rest.png", texture), ("pressed.png", moved)):
        cv2.imwrite(str(tmp_path / name), image)
    filed = zm.measure(tmp_path / "rest.png", str(tmp_path / "pressed.png"))
    np.testing.assert_array_equal(filed.displacement.du, found.du)
    assert filed.name == "pressed"
    with pytest.raises(zm.InputError, match=r"^reference: float64 \(160, 200\): "):
        zm.measure(texture.astype(float), moved)
    with pytest.raises(zm.InputError, match=r"^image: 100 x 160 px: the reference has 200 x 160 px$"):
        zm.measure(texture, moved[:, :100])
    with pytest.raises(zm.InputError, match="the rig's camera has 1280 x 1024"):
        zm.measure(texture, moved, "simulated")


def test_fringes_on_disk_are_decoded(tmp_path: Path) -> None:
    sequence = FringeSequence((9.0, 10.0, 11.0), tuple(2 * np.pi * np.arange(4) / 4))
    place = np.stack(np.meshgrid(np.arange(96) * 0.5 + 8, np.arange(80) * 0.5 + 8))
    frames = []
    for axis in range(2):
        for period in sequence.periods_px:
            for shift in sequence.shifts_rad:
                light = 0.5 + 0.5 * np.cos(2 * np.pi * place[axis] / period - shift)
                frames.append(np.rint(20 + 200 * light).astype(np.uint8))
    path = tmp_path / "frames.npy"
    np.save(path, np.stack(frames))
    found = zm.decode([path], sequence.periods_px, 4, panel_px=(64, 64), noise=None).rest_map
    assert found.valid.mean() > 0.8
    with pytest.raises(zm.InputError, match="FRAMES: 24"):
        zm.decode([path], (9.0, 10.0), 4)


def test_a_rig_is_assessed() -> None:
    rig = zm.binned(zm.load_rig("simulated"), 8)
    figures = zm.assess_rig(rig, presses=["load:3.5"], vary=["gap=0.4:0.6:2"])
    assert figures["tir"]["centre_margin_deg"] > 0
    assert len(figures["presses"]) == 1
    assert len(figures["vary"]) == 1
    assert figures["delay"]["largest_gain"].keys() == {"composition", "integrator"}


def test_a_study_is_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "_CONNECT_S", 0.2)
    study = tmp_path / "tiny.toml"
    tables = '[rig]\nbinning = 8\n[grid]\n"control.gain" = [0.3, 0.6]\n'
    study.write_text(f'schema_version = 1\ntitle = "tiny"\nframes = 3\n{tables}')
    with pytest.raises(zm.InputError, match="no Dask scheduler answers"):
        zm.run_study(study, tmp_path / "runs", Workers(address="tcp://127.0.0.1:1"))
    results = zm.run_study(study, tmp_path / "runs", 1)
    assert [row["failure"] for row in results.rows] == [None, None]
    assert "2 runs, 0 failed" in repr(results)


def test_calibrating_is_recording_and_evaluating(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def record(rig: zm.Rig, devices: zm.Devices, plan: Any, prompts: Any) -> tuple[str, str]:
        asked.extend([rig, devices, plan])
        return "recorded", "rest"

    module = "zeromethod.commissioning.calibration.calibrate"
    monkeypatch.setattr(f"{module}.record", record)
    monkeypatch.setattr(f"{module}.evaluate_or_keep", lambda *given, prompts: given)
    rig = small_rig("hold")
    assert zm.calibrate(rig, light=False) == ("recorded", "rest")
    at_rest, _, plan = asked
    assert at_rest.scenario == "none"
    assert (plan.presses, plan.light, plan.delay) == (0, False, True)
    asked.clear()
    with zm.open_devices(rig) as devices:
        zm.calibrate(rig, devices, press_depths_mm=[0.2, 0.1], ball_mm=(10.0, 0.01))
        assert asked[1] is devices
        assert devices.camera.read(1.0) is not None
    assert asked[0].scenario == "hold"
    assert asked[2].presses == 3
    with pytest.raises(zm.InputError, match="press-depths: -1"):
        zm.calibrate(rig, press_depths_mm=[-1])
