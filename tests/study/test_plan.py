"""What a study file may contain, and the message where it contains something else."""

import json
import pickle
import re
from pathlib import Path

import pytest

from zeromethod.errors import InputError
from zeromethod.study import Study, load_study, packaged_studies, parse_study
from zeromethod.study.task import StudyPress
from zeromethod.study.tasks import tasks

HEAD = 'schema_version = 1\ntitle = "t"\nframes = 4\n[rig]\nbinning = 8\n[set]\n"target.period_px" = 8\n'


def study(text: str) -> Study:
    return parse_study(HEAD + text, Path("s.toml"))


def test_a_grid_holds_every_combination_with_its_own_seed():
    found = tasks(study('[grid]\n"control.gain" = [0.5, 1.0]\n"camera.psf_px" = [0.5, 0.7, 0.9]\n'))
    pairs = [(task.rig.control.gain, task.rig.camera.psf_px) for task in found]
    assert pairs == [(0.5, 0.5), (0.5, 0.7), (0.5, 0.9), (1.0, 0.5), (1.0, 0.7), (1.0, 0.9)]
    assert len({task.rig.simulation.seed for task in found}) == 6
    assert {task.rig.simulation.seed == task.seed for task in found} == {True}
    assert found[0].rig.camera.columns == 160


def test_the_same_is_drawn_at_every_point_of_the_grid():
    text = 'repeats = 3\n[grid]\n"control.gain" = [0.5, 1.0]\n'
    head = HEAD.replace("frames = 4", "frames = 4\nrepeats = 3")
    text = '[grid]\n"control.gain" = [0.5, 1.0]\n[random]\n"camera.psf_px" = { uniform = [0.2, 1.0] }\n'
    blurs = [task.rig.camera.psf_px for task in tasks(parse_study(head + text, Path("s.toml")))]
    assert blurs[:3] == blurs[3:]
    assert len(set(blurs)) == 3


def test_press_and_planted_settings_go_where_they_belong():
    text = '"press.depth_mm" = 0.1\n"bench.prism.index" = 1.42\n[press]\nsize_mm = 3\n'
    (task,) = tasks(study(text))
    assert (task.press.depth_mm, task.press.size_mm) == (0.1, 3.0)
    assert task.rig.prism.index == 1.41
    assert task.bench.prism.index == 1.42
    assert task.bench.simulation == task.rig.simulation


def test_dotted_keys_need_no_quotes():
    (first, second) = tasks(study("[grid]\ncontrol.gain = [0.5, 1.0]\n"))
    assert (first.rig.control.gain, second.rig.control.gain) == (0.5, 1.0)


def test_a_task_survives_its_way_to_a_worker():
    (task,) = tasks(study('"bench.prism.index" = 1.42\n[press]\ndepth_mm = 0.1\n'))
    assert pickle.loads(pickle.dumps(task)) == task


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[grid]\n"control.gian" = [1.0]\n', 'grid: "control.gian": unknown key: did you mean control.gain?'),
        ('[grid]\n"control.gain" = [1.0, 2.0]\n', "control.gain: 2.0: a number above 0 and at most 1"),
        ('[grid]\n"camera.hue" = [1.0]\n', 'grid: "camera.hue": unknown key'),
        (
            "[grid]\ncontrol.gian = [1.0]\n[figure]\ny = 'state'\nx = 'control.gain'\n",
            'grid: "control.gian": unknown key: did you mean control.gain?',
        ),
        (
            '"bench.prism.indx" = 1.4\n',
            'set: "bench.prism.indx": unknown key: did you mean bench.prism.index?',
        ),
        ("[press]\n[random]\npress.deep_mm = { uniform = [0.0, 1.0] }\n", "did you mean press.depth_mm?"),
        ('[grid]\n"control.gain" = [nan]\n', "control.gain: nan: a number above 0"),
        ('"control.gain" = 1.0\n[grid]\n"control.gain" = [1.0]\n', "grid.control.gain: also under [set]"),
        ('"press.depth_mm" = 1.0\n', "press.depth_mm: only with a table [press]"),
        ("[press]\ndeep_mm = 1.0\n", "press.deep_mm: unknown key"),
        ("[press]\ndepth_mm = 'a'\n", "press.depth_mm"),
        ('"rig.binning" = 7\n', "rig.binning: 7: a whole number that divides 1280 and 1024"),
        ('"rig.file" = "mine.toml"\n', "rig.file: mine.toml: cannot be read"),
        ('scenario = "nothing"\n', "press: nothing: a readable press file"),
        ("[figure]\ny = 'state'\n", "figure.x: missing"),
        ("[figure]\nx = 'run'\ny = 'depth'\n", 'figure.y: "depth": one of'),
        ("[figure]\nx = 'run'\ny = 'state'\nscale = 'cubic'\n", 'figure.scale: "cubic": one of'),
        ("[figure]\nx = 'run'\ny = 'state'\nhue = ['gap']\n", 'figure.hue: "gap": one of'),
        ("[gird]\na = 1\n", "gird: unknown key: did you mean grid?"),
        ("[random]\ngap = 3\n", "random.gap: 3: one of { uniform"),
        ('gap = "a"\n', "could not convert"),
        ("[grid]\ncontrol.gain = {}\n", "grid.control.gain: a table: a list of values, or {"),
        ("[random]\ncontrol.gain = {}\n", "random.control.gain: a table: one of { uniform"),
    ],
)
def test_an_error_is_reported_in_one_line_by_file_and_key(text, message):
    with pytest.raises(InputError, match=r"^(s\.toml|press): ") as caught:
        tasks(study(text))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("random.camera.noise.read_grey = { unifrm = [0.5, 4.0] }", "random.camera.noise.read_grey: unifrm"),
        ("random.gap = { norml = [50.0, 1.0] }", "random.gap: norml"),
        ("random.gap = { uniform = [50.0, 60.0], beta = 1 }", "random.gap: beta"),
        (
            'random."pattern_layers[0].thickness_mm" = { chioce = [0.5, 4.0] }',
            "random.pattern_layers[0].thickness_mm: chioce",
        ),
        ("grid.control.gain = { form = 0.1, to = 1.0, steps = 3 }", "grid.control.gain: form"),
        ("grid.control.gain = { values = [0.1, 1.0] }", "grid.control.gain: values"),
        ("grid.control.gain = { uniform = [0.1, 1.0] }", "grid.control.gain: uniform"),
        (
            'grid.control.gain = { from = 0.1, to = 1.0, steps = 3, scael = "log" }',
            "grid.control.gain: scael",
        ),
    ],
)
def test_a_mistyped_word_of_a_table_of_values_is_reported(given, message):
    words = "from, to, steps, scale" if message.startswith("grid") else "uniform, log_uniform, normal, choice"
    with pytest.raises(InputError) as caught:
        tasks(parse_study(f"{given}\n{HEAD}", Path("s.toml")))
    assert str(caught.value) == f"s.toml: {message}: one of {words}"


def test_what_a_press_has_by_default_is_in_the_manual():
    manual = (Path(__file__).parents[2] / "docs" / "study.md").read_text()
    documented: dict[str, str] = {}
    for keys, defaults in re.findall(r"^\| (`[a-z_`, ]+`) \| (.+?) \|", manual, re.MULTILINE):
        names = re.findall(r"\w+", keys)
        documented |= dict(zip(names, defaults.split(", ") if len(names) > 1 else [defaults], strict=True))
    for name, value in StudyPress().model_dump(mode="json").items():
        assert documented[name].strip("`") == json.dumps(value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("title = 't'", "schema_version: missing: 1 is"),
        ("schema_version = 2\ntitle = 't'", "schema_version: 2: 1 is"),
        ("schema_version = 1", "title: missing"),
        ("schema_version = 1\ntitle = 't'\nprocedure = 'walk'", 'procedure: "walk": one of run, averaging'),
        ("schema_version = 1\ntitle = 't'\nmetrics = ['loop_ms']", 'metrics: "loop_ms": of procedure'),
        ("schema_version = 1\ntitle = 't'\nframes = 3\nseconds = 1.0", "seconds: 1: frames or seconds"),
        ("schema_version = 1\ntitle = 't'\nseconds = nan", "seconds: nan: a number above 0"),
        ("schema_version = 1\ntitle = 't'\nlimit_s = inf", "limit_s: inf: a number above 0"),
        (
            "schema_version = 1\ntitle = 't'\nrecordings = ['no*.h5']",
            'recordings: "no*.h5": no file matches below /',
        ),
        ("schema_version = 1\ntitle = 't'\nprocedure = 'from_warps'", "recordings: needed by procedure"),
        ("a =", "not TOML"),
    ],
)
def test_a_file_that_is_no_study_is_refused(text, message):
    with pytest.raises(InputError, match=r"^s\.toml: ") as caught:
        tasks(parse_study(text, Path("s.toml")))
    assert message in str(caught.value)


@pytest.mark.parametrize("name", packaged_studies())
def test_packaged_studies_are_sound(name):
    packaged = load_study(name)
    assert len(tasks(packaged)) == packaged.count
    assert packaged.table.figure is not None
