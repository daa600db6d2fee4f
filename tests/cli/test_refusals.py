"""Bad input to any command: one line that says where and what, exit code 2, and nothing is written."""

from __future__ import annotations

import importlib
import os
import shutil
import time
from pathlib import Path

import click
import cv2
import numpy as np
import pytest
from command_line import run
from recorded_run import recorded
from small_rigs import BENCH_160, small_rig_file

import benchmarks
from benchmarks.against_peers.open_loop import coarser
from zeromethod.drivers.monitors import Monitor
from zeromethod.resources import resource
from zeromethod.rig.load import load_rig
from zeromethod.rig.save import save_values

MONITORS = (
    Monitor(0, "eDP-1", 2560, 1440, 144.0, 0, 0, 1.0, primary=True),
    Monitor(1, "HDMI-1", 1920, 1080, 59.94, 2560, 0, 1.0, primary=False),
    Monitor(2, "DP-2", 1920, 1080, 75.0, 4480, 0, 1.0, primary=False),
)
LISTED = (
    "0 (eDP-1, 2560 x 1440, 144.00 Hz, at 0, 0), 1 (HDMI-1, 1920 x 1080, 59.94 Hz, at 2560, 0), "
    "2 (DP-2, 1920 x 1080, 75.00 Hz, at 4480, 0)"
)
MODE = "(1920 x 1080 px at 60 Hz): set the monitor or the rig file; monitors: " + LISTED
UNSEEN = "the simulated camera cannot observe a monitor; allowed: with --camera, or a rig file with a camera"
NO_SETTING = "the simulated camera has none; allowed: with --camera"
PYLON = "run --camera pylon --display 1"
CALIBRATE = "calibrate --rig simulated"
BOARD = "calibrate board --output board.png --board 12x9:10"
FRINGES = "calibrate fringes --periods 16,18 --shifts 6"
LOOP_ONLY = "only with --mode closed-loop"
HELPERS = {
    "__init__",
    "loads",
    "pads",
    "report",
    "rigs",
    "dents",
    "hand_presses",
    "live_running",
    "browser",
    "memory_devices",
    "process_use",
    "salt",
    "totals",
    "fringe_bench",
    "parts",
    "against_peers",
}
BENCHMARKS = sorted({path.stem for path in Path(str(benchmarks.__file__)).parent.glob("*.py")} - HELPERS)

OF_SIMULATED = "of the simulated bench, and these devices are real: leave it out"
REFUSALS = [
    ("walk", "No such command 'walk'"),
    ("run --colour red", "--colour"),
    ("run --rig nowhere.toml", "nowhere.toml"),
    ("run --rig nothing", "--rig: \"nothing\": a file, or one of the packaged contactless, cylinder"),
    ("run --rig calibrations", "\"calibrations\": a folder: give the file in it: calibrations/my/b/rig.toml"),
    ("check --rig calibrations/my/a", "a folder: give the file in it: calibrations/my/a/rig.toml"),
    ("run --scenario nothing", "--scenario: nothing: a press file (.toml), or one of approach, ball"),
    ("virtual-bench --scenario nothing", "--scenario: nothing: a press file (.toml), or one of approach"),
    (f"run --scenario {300 * 'a'}", ": a press file (.toml), or one of approach, ball"),
    (f"design {300 * 'a'}", "cannot be read: File name too long: a rig file (TOML)"),
    ("run --rig jelly.toml", 'rubber.support: "jelly": one of "bonded", "sliding", "free", or a table of'),
    ("run --gain 2", "--gain: 2: a number above 0, at most 1"),
    ("run --view --publish foo", "--publish: 'foo': not an address: tcp://HOST:PORT with a free port"),
    ("run --frames 0", "--frames: 0: a whole number from 1"),
    (
        "run --rig interactive --rubbing",
        "--rubbing: not under a cloth ([cloth] or [projector]), which hides what rubs",
    ),
    ("run --rig interactive --project x", "--project: x: a whole number from 0"),
    ("run --project 0", "--project: 0: rig 'simulated' has no table [projector]; allowed: with a rig"),
    ("run --rig crossed.toml", "projector.corners_mm: [[8.0, -21.0], [76.0, -22.0], [77.0, 22.0], [7.0,"),
    ("run --rig three.toml", "three.toml: projector.corners_mm[3]: missing: a list of 2 numbers"),
    ("run --rig film.toml", 'projector.picture: "film": one of "pointers", "white", "black"'),
    ("run --rig bare.toml", "projector.driver: \"simulated\": 'window' without a table [cloth]"),
    ("run --rig nowhere-shown.toml", "projector.monitor: missing: an index, as `zeromethod devices` lists"),
    ("run --rig loose.toml", "cloth.pressed: 0.01: a number from touching, 0.05, to 0.75"),
    ("run --rig glowing.toml", "control.lamp: true: false under a cloth, whose threads the projector lights"),
    ("run --rig printed --rubbing", "--rubbing: not under a lamp or on a saw ([light] or [prism.teeth])"),
    ("run --passive --rubbing", "--rubbing: not in a passive run, in which nothing is lit white"),
    ("run --rig thinn", "cylinder, dome, interactive, leds, paper,"),
    ("run --frames 3 --seconds 1", "--frames and --seconds: give one of them, not both"),
    ("run --rig ring.toml", "light.ring_mm: [30.0, 20.0]: inner, outer with inner below outer"),
    ("run --rig room.toml", "light.room: -0.1: "),
    ("run --rig mains.toml", "light.mains_hz: 0: "),
    ("run --rig lit.toml", 'light.source: "lamp": only with control.controller "passive": a lamp lights a'),
    ("run --passive --gain 0.5", "--passive and --gain: give one of them: a passive run has no loop"),
    ("run --rig printed --fine", "rig 'printed', which is passive, and --fine: give one of them: a passive"),
    ("run --rig printed --display 1", "--display: 1: rig 'printed': a lamp lights a print (light.source); "),
    ("calibrate --rig printed", "rig 'printed': control.controller: 'passive': a pattern that stays cannot"),
    ("check --rig printed", "rig 'printed': control.controller: 'passive': a pattern that stays cannot"),
    ("run --passive --fine", "--passive and --fine: give one of them: a passive run has no loop"),
    ("design --pattern print.jpg", "--pattern: print.jpg: the file name must end in .png"),
    ("run --watch-camera 1", "--watch-camera: '1': the rig has no table [watch]; allowed: with"),
    ("run --rig contactless --watch-camera nowhere", "--watch-camera: 'nowhere': allowed: an index (0)"),
    ("run --rig contactless --watch-camera 1", "--watch-camera: '1': camera and watch camera are both"),
    ("run --rig contactless --watch-camera 1 --simulate", "--simulate and --watch-camera: give one of"),
    ("run --rig odd.toml", "watch.columns: 321: an even number: two views side by side"),
    ("run --rig one-lens.toml", "watch.baseline_mm: missing: a number above 0, from the left lens"),
    ("run --controller magic", "--controller: 'magic' is not one of 'composition', 'integrator'."),
    ("run --figure run.jpeg", "--figure: run.jpeg: the file name must end in .png"),
    ("run --summary no/such/folder/run.json", "--summary: no/such/folder/run.json: the folder "),
    ("run --latency -1.1", "--latency: -1.1: a number from -1 to 10\n"),
    ("run --exposure 1e-300", "--exposure: 1e-300: a number at least 1e-07 and at most 60"),
    ("check --press-depth 0", "--press-depth: 0: a number above 0"),
    ("check --press-depth 7", "--press-depth: 7: depths in mm, at most 6 (a tenth of the prism's"),
    ("check --depth-sigma nan", "--depth-sigma: nan: a number above 0"),
    ("check --rig nowhere.toml", "nowhere.toml"),
    ("check --display 1", UNSEEN),
    # arrays of LEDs and photodetectors
    ("run --rig leds --fine", "--fine: not with rig 'leds': arrays have --camera, --simulate"),
    ("run --rig leds --passive", "--passive: not with rig 'leds': arrays have"),
    ("run --rig leds --display 1", "--display: not with rig 'leds': arrays have"),
    ("run --rig leds --view :0", "--view: not with rig 'leds': arrays have"),
    ("run --rig leds --frames 3 --seconds 1", "--frames and --seconds: give one of them, not both"),
    ("run --rig leds --camera 0", "--camera: '0': allowed: \"simulated\", udp://HOST:PORT, or serial"),
    ("run --rig leds --camera udp://127.0.0.1:5999 --scenario step", f"--scenario: step: {OF_SIMULATED}"),
    ("run --rig leds --camera udp://127.0.0.1:5999 --seed 1", f"--seed: 1: {OF_SIMULATED}"),
    ("run --display 1 --camera 0 --scenario step", f"--scenario: step: {OF_SIMULATED}"),
    ("check --display 1 --camera 0 --seed 3", f"--seed: 3: {OF_SIMULATED}"),
    ("run --rig leds --camera serial:///dev/none", "--camera: 'serial:///dev/none': cannot be opened: No"),
    ("run --rig leds --simulate --camera udp://h:1", "--simulate and --camera: give one of them, not both"),
    ("run --rig leds --scenario nothing", "--scenario: nothing: a press file (.toml), or one of"),
    ("run --rig leds --publish here", "--publish: 'here': not an address"),
    ("run --rig leds --record notes.h5", "is there already"),
    ("run --rig dark.toml", "dark.toml: leds: missing: a table"),
    ("run --rig shaded.toml", "shaded.toml: shade: unknown key: known are schema_version, name, prism"),
    ("run --rig shaded.toml", "simulation, scenario; leds: missing"),
    ("run --rig arrays.toml", 'leds.spot_mm: 5.0: 0.35 to 0.8 of leds.pitch_mm: narrower spots leave gaps'),
    ("run --rig aside.toml", "frame.x_mm: [200.0, 300.0]: on the mirror, 0 to 77."),
    ("design leds", 'arrays of LEDs and photodetectors have no camera: only `run` and `replay` take'),
    ("calibrate --rig leds", '--rig: "leds": arrays of LEDs and photodetectors have no camera: only `run`'),
    ("check --rig leds", '--rig: "leds": arrays of LEDs and photodetectors have no camera: only `run`'),
    ("check --rig arrays.toml", "arrays.toml: [leds]: arrays of LEDs and photodetectors have no camera"),
    # recordings
    ("run --keep frames", "--keep: only with --record FILE.h5"),
    ("run --every 2", "--every: only with --record FILE.h5"),
    ("run --compress", "--compress: only with --record FILE.h5"),
    ("run --record run.h5 --keep ''", "--keep: '': of frames, "),
    ("run --record run.h5 --keep frames,depth", "--keep: 'depth': of frames, "),
    ("run --record run.mp4", "run.mp4: a recording's name ends in .h5 or .hdf5"),
    ("run --record none/run.h5", "does not exist"),
    ("run --record notes.h5", "is there already"),
    # devices
    ("run --display 5 --camera 0", f"--display: 5: no such monitor; allowed: {LISTED}\n"),
    ("run --display 0 --camera 0", f"--display: 0: set to another mode than the rig's display {MODE}\n"),
    ("run --display 2 --camera 0", f"--display: 2: set to another mode than the rig's display {MODE}\n"),
    ("run --display 1", f"--display: 1: {UNSEEN} of its own\n"),
    ("run --display 1 --camera simulated", f"--display: 1: {UNSEEN} of its own\n"),
    (
        "run --camera 0",
        "--camera: '0': a camera cannot observe the simulated display; allowed: with --display, or a rig "
        "file with a display of its own\n",
    ),
    (
        "run --rig opencv.toml",
        "camera.driver: 'opencv': a camera cannot observe the simulated display; allowed: with --display",
    ),
    (
        "run --display 1 --camera film.mp4",
        "--camera: 'film.mp4': allowed: an index (0), a URL (tcp://, http://, rtsp://), a video file, "
        "pylon[:serial], aravis[:address], package.module:Name, or an installed driver\n",
    ),
    ("run --exposure 0", "--exposure: 0: a number above 0\n"),
    ("run --exposure 0.02", "--exposure: 0.02: at most the frame time, 0.0166667\n"),
    ("run --camera-gain -1 --camera 0 --display 1", "--camera-gain: -1: a number from 0\n"),
    ("run --camera-gain 3", f"--camera-gain: {NO_SETTING}\n"),
    ("run --pixel-format Mono8", f"--pixel-format: {NO_SETTING}\n"),
    (f"{PYLON} --pixel-format ''", '--pixel-format: "": text that is not empty\n'),
    ("run --trigger free", f"--trigger: {NO_SETTING}\n"),
    ("run --trigger none", "--trigger: 'none' is not one of 'free', 'software', 'hardware'.\n"),
    ("run --region 0 0 1280 1024 --camera simulated", f"--region: {NO_SETTING}\n"),
    (f"{PYLON} --region 0 0 640 512", "--region: [0, 0, 640, 512]: 1280, 1024 (columns, rows) at its end\n"),
    ("devices --focus --delay", "--delay and --focus: give one of them\n"),
    ("devices --identify 1 --focus", "--identify and --focus: give one of them\n"),
    ("devices --speed --focus", "--focus and --speed: give one of them\n"),
    ("devices --identify x", "--identify: 'x': allowed: the index of a monitor, or nothing for all\n"),
    ("devices --write", "--write: only with --delay\n"),
    ("devices --focus --write", "--write: only with --delay\n"),
    ("devices --camera 0", "--camera: only with --delay or --focus\n"),
    ("devices --speed --display 0", "--display: only with --delay or --focus\n"),
    ("devices --identify --exposure 0.1", "--exposure: only with --delay or --focus\n"),
    ("devices --rig paper", "--rig: only with --identify, --delay, --focus or --speed\n"),
    ("devices --seconds 3", "--seconds: only with --identify, --delay or --focus\n"),
    ("devices --speed --seconds 3", "--seconds: only with --identify, --delay or --focus\n"),
    ("devices --delay --seconds 0", "--seconds: 0: a number above 0\n"),
    ("devices --delay --write", "--write: 'simulated': with --rig and a rig file of your own\n"),
    ("devices --delay --write --rig paper", "--write: 'paper': with --rig and a rig file of your own\n"),
    ("devices --focus --summary focus.txt", "--summary: focus.txt: the file name must end in .json\n"),
    # from a recording
    ("report missing.h5", "missing.h5: not there"),
    ("report folder.h5", "folder.h5: is a folder; give a recording (HDF5)"),
    ("report folder.h5 --follow", "folder.h5: is a folder; give a recording (HDF5)"),
    ("report notes.h5", "notes.h5: cannot be read as a recording"),
    ("report notes.h5 --follow", "notes.h5: cannot be read as a recording"),
    ("report notes.h5 --output page.pdf", "--output: page.pdf: the file name must end in .html"),
    ("report notes.h5 --follow --output a.html", "--follow and --output"),
    ("report nowhere/run.h5 --follow", "does not exist"),
    ("export run.h5 a.obj", "OUT: a.obj: the file name must end in .npz, .tif"),
    ("export run.h5 a.npz a.csv --format csv", "--format: csv: for one OUT only"),
    ("export run.h5 a.npz a.npz", "OUT: the same file is named twice"),
    ("export run.h5 a.csv --at 1", "--at: 1: only with a mesh (.ply, .stl)"),
    ("export run.h5 a.npz --pitch 0.1", "--pitch: 0.1: for a .tif only"),
    ("export run.h5 a.stl --every 2", "--every: 2: a mesh is of one time"),
    ("export run.h5 no/a.csv", "OUT: no/a.csv: the folder "),
    ("export run.h5 a.npz --from 5", "no surface recorded from 5 to "),
    ("export run.h5 a.npz --from 0.3 --to 0.2", "--from: 0.3: must not be after --to (0.2)"),
    ("export run.h5 a.npz --from nan", "--from: nan: seconds"),
    ("export run.h5 a.ply --at nan", "--at: nan: seconds"),
    ("export run.h5 a.tif --pitch 100", "--pitch: 100 mm: gives "),
    ("export run.h5 a.tif --pitch nan", "--pitch: nan: a number above 0"),
    ("export run.h5 run.h5 --format npz", "zeromethod: OUT: run.h5: is the recording itself\n"),
    ("export folder.h5 a.csv", "zeromethod: folder.h5: is a folder; give a recording (HDF5)\n"),
    ("export notes.h5 a.csv", "notes.h5: "),
    ("replay nowhere.h5", "not there"),
    ("replay notes.h5", "cannot be read as a recording"),
    ("replay run.h5 --gain 0.5", LOOP_ONLY),
    ("replay run.h5 --record x.h5", LOOP_ONLY),
    ("replay run.h5 --mode closed-loop --record notes.h5", "never replaces a file"),
    ("replay run.h5 --set surface.rest=1", "surface.rest: unknown key"),
    ("replay run.h5 --set target.period_px=20", "cannot be changed"),
    ("replay run.h5 --from 9", "nothing is there"),
    ("replay run.h5 --rig nobench", "rig: "),
    ("replay run.h5 --figure x.pdf", "--figure: x.pdf: the file name must end in .png"),
    ("replay run.h5 --speed inf", "--speed: inf: a number above 0"),
    ("replay bare.h5", "recorded without warps"),
    ("replay bare.h5 --mode from-frames", "recorded without frames"),
    ("replay bare.h5 --mode closed-loop", "recorded without surfaces"),
    # all else
    ("study none.toml", "none.toml: cannot be read: No such file or directory: a study file (TOML)"),
    (
        "study nothing",
        "zeromethod: FILE: nothing: a study file (.toml), or one of the packaged calibration-budget, "
        "fold-limit, gain-delay, noise-floor",
    ),
    ("study gain-delay --retry-failed --restart", "--retry-failed: not with --restart, which does every run"),
    ("study gain-delay --cluster tcp://127.0.0.1:9 --workers 2", "--workers: 2: not with --cluster"),
    ("study gain-delay --output notes.h5", "--output"),
    ("study gain-delay --summary a.txt", "--summary: a.txt: the file name must end in .json"),
    ("design nowhere", "RIG: \"nowhere\": a file, or one of"),
    ("design small.toml --vary angle=45", "--vary: 'angle=45'"),
    ("design small.toml --vary angel=45:60", "--vary: 'angel'"),
    ("design small.toml --press needle:1", "--press: 'needle:1'"),
    ("design small.toml --pupil 0", "--pupil: 0: a number above 0"),
    ("design small.toml --computing -1", "--computing: -1: a number from 0"),
    ("design small.toml --figure design.jpg", "--figure: design.jpg"),
    ("design small.toml --summary nowhere/design.json", "--summary: nowhere/design.json"),
    ("design off.toml", "simulated: display.centre_mm: (900.0, 0.0): the centre ray ends at column"),
    ("measure rest.png nowhere.tif", "nowhere.tif: cannot be read"),
    ("measure rest.png notes.tif", "notes.tif: not an image"),
    ("measure rest.png small.png", "the reference has 140 x 120 px"),
    ("measure rest.png rest.png folder.h5/rest.png", "would overwrite"),
    ("measure rest.png rest.png --rig simulated", "140 x 120 px: the rig's camera has 1280 x 1024 px"),
    ("measure rest.png rest.png --window 1", "--window: 1: a number from "),
    ("reproduce --summary figures.txt", "--summary: figures.txt: the file name must end in .json"),
    ("reproduce --output notes.h5", "--output: notes.h5: must be a folder that can be made"),
    ("virtual-bench --start-after -1", "--start-after: -1: a number from 0"),
    ("virtual-bench --rate 1000", "--rate: 1000: above 0 and at most 1 / camera.exposure_s = 125 Hz"),
    ("virtual-bench --repeat 2 --forever", "--repeat and --forever: give one of them, not both"),
    ("calibrate", "--rig: missing"),
    (f"{CALIBRATE} --press-depths 0.2,x", "--press-depths"),
    (f"{CALIBRATE} --press-depths -0.2", "--press-depths"),
    (f"{CALIBRATE} --press-depths 0.2,1000", "--press-depths: 1000: depths in mm, at most"),
    (f"{CALIBRATE} --depth-sigma 0", "--depth-sigma"),
    (f"{CALIBRATE} --known gap_mm=0.5", "--known"),
    (f"{CALIBRATE} --known speed=0.5:0.1", "not a parameter"),
    (f"{CALIBRATE} --known gap_mm=nan:1", "must be finite"),
    (f"{CALIBRATE} --known gap_mm=-3:0.01", "gap_mm=-3: a number at least 0"),
    (f"{CALIBRATE} --known prism.captured_less_pattern_deg=80:1", "camera_angle_deg: 130"),
    (f"{CALIBRATE} --known prism.pattern_angle_deg=90:1", "at least 5 and at most 85"),
    ("calibrate --rig paper --known camera.k1=0:0.1", "this rig has none"),
    (f"{CALIBRATE} --edge-point Q0=1,2", "--edge-point"),
    (f"{CALIBRATE} --edge-point P0=1", "--edge-point"),
    (f"{CALIBRATE} --edge-point P0=1300,5", "1280 x 1024"),
    (f"{CALIBRATE} --press-ball 800", "--press-ball"),
    (f"{CALIBRATE} --press-ball -800:4", "--press-ball"),
    (f"{CALIBRATE} --press-ball nan:4", "--press-ball"),
    (f"{CALIBRATE} --intrinsics nowhere.toml", "--intrinsics: nowhere.toml"),
    (f"{CALIBRATE} --summary found.txt", "--summary"),
    (f"{CALIBRATE} --show", "no calibration"),
    ("calibrate --rig nothing --show", "--rig: \"nothing\": a file, or"),
    ("calibrate --press-depths 0.2 0.15", "--press-depths: 0.15 by itself: commas between depths"),
    ("calibrate --show", "--show"),
    ("calibrate --show nowhere", "nowhere"),
    ("calibrate --show nowhere --known gap_mm=0.5:0.1", "--known: not with --show; allowed: --rig, --sum"),
    ("calibrate --diff nowhere nowhere", "nowhere"),
    ("calibrate --diff a b --summary d.json", "--summary: not with --diff; allowed: none other"),
    ("calibrate --evaluate-again nowhere", "nowhere"),
    ("calibrate --evaluate-again nowhere --known gap_mm=nan:1", "must be finite"),
    ("calibrate --evaluate-again nowhere --display 1", "--display: not with --evaluate-again"),
    (f"{CALIBRATE} --patience nan", "zeromethod: --patience: nan: a number above 0\n"),
    ("calibrate intrinsics --patience 0", "zeromethod: --patience: 0: a number above 0\n"),
    ("calibrate weight --rig small.toml", "Missing option '--grams'"),
    ("calibrate weight --grams 20", "Missing option '--rig'"),
    ("calibrate weight --rig small.toml --grams 0", "--grams: 0: a number above 0, at"),
    ("calibrate weight --rig small.toml --grams 1e9", "--grams: 1e9: a number above 0, at most 10000\n"),
    ("calibrate weight --rig locked.toml --grams 20", "--rig: locked.toml: cannot be written: File name too"),
    ("calibrate weight --rig small.toml --grams 20 --grams-sigma 12", "--grams-sigma: 12: below half of"),
    ("calibrate weight --rig nowhere.toml --grams 20", "nowhere.toml"),
    ("calibrate weight --rig simulated --grams 20", "--rig: simulated: a rig file of your own"),
    ("calibrate weight --rig small.toml --grams 20 --scenario nothing", "--scenario: nothing"),
    ("calibrate board --dpi nan", "zeromethod: --dpi: nan: a number from 10 to 10000\n"),
    # output paths that cannot be written
    ("run --figure taken.png", "--figure: taken.png: cannot be written: Is a directory\n"),
    ("run --summary taken.json", "--summary: taken.json: cannot be written: Is a directory\n"),
    ("run --figure nul.png", "--figure: nul.png: cannot be written: not a file\n"),
    ("run --record /proc/run.h5", "/proc/run.h5: cannot be written: No such file or directory\n"),
    ("report run.h5 --output taken.html", "--output: taken.html: cannot be written: Is a directory\n"),
    ("export run.h5 /proc/a.csv", "OUT: /proc/a.csv: cannot be written: No such file or directory\n"),
    ("replay run.h5 --figure taken.png", "--figure: taken.png: cannot be written: Is a directory\n"),
    ("replay run.h5 --mode closed-loop --record /proc/x.h5", "--record: /proc/x.h5: cannot be written"),
    ("design small.toml --figure taken.png", "--figure: taken.png: cannot be written: Is a directory\n"),
    ("init /proc/a.toml", "FILE: /proc/a.toml: cannot be written"),
    ("calibrate board --output taken.png", "--output: taken.png: cannot be written: Is a directory\n"),
    ("calibrate intrinsics --output /proc/a.toml", "--output: /proc/a.toml: cannot be written"),
    ("calibrate decode a.png --output /proc/a.npz", "--output: /proc/a.npz: cannot be written"),
    ("virtual-bench --truth /proc/a.jsonl", "--truth: /proc/a.jsonl: cannot be written"),
    ("measure rest.png rest.png --output /proc", "--output: /proc: cannot be written"),
    ("study gain-delay --output /proc", "--output: /proc: cannot be written"),
    ("reproduce --output /proc", "--output: /proc: cannot be written"),
    (BOARD, "--dpi, --rig: one of them"),
    (f"{BOARD} --dpi 300 --rig simulated", "--dpi, --rig: one of them"),
    (f"{BOARD} --dpi 20", "at least 16"),
    (f"{BOARD} --board 12x9:2.5 --rig simulated", "2.52 mm are"),
    (f"{BOARD} --board 30x20:6.3 --rig simulated --dictionary 5X5_1000", "the LCD has 1920 x 1080"),
    *((f"init my.toml {one}", one.split()[0]) for one in ("--index 0.5", "--pixel -3", "--camera-angle 90")),
    ("init my.txt", "must end in .toml"),
    ("init no/my.toml", "does not exist"),
    ("init my.toml --lens 900", "--lens"),
    ("init my.toml --from nothing", "--from: \"nothing\": a file, or one of the packaged contactless"),
    ("calibrate fringes --shifts 6 --panel 64 48 --output x", "--periods"),
    (f"{FRINGES} --output x", "--rig and --panel: give one of them: the size of the LCD\n"),
    (f"{FRINGES} --rig simulated --panel 64 48 --output x", "--rig and --panel: give one of them"),
    (f"{FRINGES} --rig nowhere.toml --output x", "nowhere.toml"),
    (f"{FRINGES} --panel 8 48 --output x", "--panel: 8: a whole number from 16 to 16384\n"),
    (f"{FRINGES} --panel 64 48 --output notes.h5", "--output: notes.h5: must be a folder that can be made"),
    (f"{FRINGES} --panel 64 48 --output notes.h5/x", "--output: notes.h5/x: must be a folder that can be"),
    ("calibrate fringes --periods 16,18 --shifts 2 --panel 64 48 --output x", "--shifts: 2: a count"),
    ("calibrate fringes --periods 16 --shifts 6 --panel 64 48 --output x", "periods: 16: two or more"),
    *((f"benchmarks.{name} --colour", "--colour") for name in BENCHMARKS),
    ("benchmarks.sigma --summary sigma.txt", "--summary: sigma.txt: the file name must end in .json"),
    ("benchmarks.sigma --summary no/such/folder/s.json", "does not exist"),
    ("benchmarks.calibration_benches --benches 0", "--benches: 0: a whole number from 1"),
    ("benchmarks.recording_cost --keep sound", "--keep: 'sound'"),
    ("benchmarks.recording_cost --folder no/such/folder", "--folder"),
    ("benchmarks.window_speed --pictures many", "--pictures: many: a whole number from 2"),
    ("benchmarks.against_peers.__main__ --part everything", "--part: 'everything' is not one of 'displ"),
    ("benchmarks.against_peers.__main__ --figure bench.jpeg", "--figure: bench.jpeg: the file name must"),
    ("benchmarks.against_peers.__main__ --summary no/such/b.json", "does not exist"),
    ("benchmarks.against_peers.__main__ --fast", "--fast"),
]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the commands are given: recordings, rig files, images, and files that are none of these."""
    folder = tmp_path_factory.mktemp("given")
    for name in ("folder.h5", "taken.png", "taken.json", "taken.html"):
        (folder / name).mkdir()
    (folder / "nul.png").symlink_to(os.devnull)
    for name in "ab":
        (folder / "calibrations" / "my" / name).mkdir(parents=True)
        (folder / "calibrations" / "my" / name / "rig.toml").touch()
    for name in ("notes.h5", "notes.tif"):
        (folder / name).write_text("no recording, no image")
    os.utime(folder / "notes.h5", (time.time() - 60,) * 2)
    rig = coarser(load_rig("simulated"), 8)
    recorded(folder / "run.h5", 0.4, rig=rig)
    recorded(folder / "bare.h5", 0.1, rig=rig, keep=("residual",))
    small = small_rig_file(folder / "small.toml", BENCH_160)
    # longer by the name of its part, none can be written, whoever runs the tests
    (folder / "locked.toml").symlink_to(shutil.copy(small, folder / f"{'long' * 60}.toml"))
    save_values(small, {"display.centre_mm": [900.0, 0.0]}, folder / "off.toml")
    save_values(small, {"camera.driver": "opencv", "camera.source": 0}, folder / "opencv.toml")
    text = small.read_text()
    (folder / "jelly.toml").write_text(text.replace('support = "free"', 'support = "jelly"'))
    arrays = resource("calibration", "rigs", "leds.toml").read_text()
    (folder / "arrays.toml").write_text(arrays.replace("spot_mm = 1.0", "spot_mm = 5.0"))
    start, end = arrays.index("[leds]"), arrays.index("[detectors]")
    (folder / "dark.toml").write_text(arrays[:start] + arrays[end:])
    (folder / "shaded.toml").write_text(f"{arrays[:start]}[shade]\nof = 1\n{arrays[end:]}")
    (folder / "aside.toml").write_text(arrays.replace("x_mm = [17.0, 67.0]", "x_mm = [200.0, 300.0]"))
    watched = resource("calibration", "rigs", "contactless.toml").read_text()
    (folder / "one-lens.toml").write_text(watched.replace("baseline_mm", "# "))
    (folder / "odd.toml").write_text(watched.replace("columns = 320 ", "columns = 321 "))
    cloth = resource("calibration", "rigs", "interactive.toml").read_text()
    corners = "[7.0, 21.0], [77.0, 22.0]]"
    on_cloth = {
        "crossed": (corners, "[77.0, 22.0], [7.0, 21.0]]"),
        "three": (corners, "[7.0, 21.0]]"),
        "film": ('picture = "pointers"', 'picture = "film"'),
        "loose": ("pressed = 0.6", "pressed = 0.01"),
        "glowing": ("lamp = false", "lamp = true"),
        "nowhere-shown": ('[projector]\ndriver = "simulated"', '[projector]\ndriver = "window"'),
        "bare": (cloth[cloth.index("[cloth]") : cloth.index("[projector]")], ""),
    }
    for name, (given, wrong) in on_cloth.items():
        (folder / f"{name}.toml").write_text(cloth.replace(given, wrong))
    (folder / "lit.toml").write_text(text + '\n[light]\nsource = "lamp"\n')
    for name, line in (
        ("ring", "ring_mm = [30.0, 20.0]"),
        ("room", "room = -0.1"),
        ("mains", "mains_hz = 0"),
    ):
        (folder / f"{name}.toml").write_text(f"{text}\n[light]\n{line}\n")
    grey = np.random.default_rng(0).integers(0, 256, (120, 140), dtype=np.uint8)
    for name, image in (("rest", grey), ("small", grey[:60, :60])):
        cv2.imwrite(str(folder / f"{name}.png"), image)
    shutil.copy(folder / "rest.png", folder / "folder.h5")
    return folder


def state_of(folder: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*")}


@pytest.mark.parametrize(("line", "words"), REFUSALS, ids=[line for line, _ in REFUSALS])
def test_bad_input_is_refused_in_one_line(line, words, folder, monkeypatch):
    monkeypatch.setattr("zeromethod.drivers.monitors.monitors", lambda: MONITORS)
    for command in ("calibrate_bench", "calibrate_weight"):  # nothing may come as far as that
        monkeypatch.delattr(f"zeromethod.cli.{command}.opened_devices")
    monkeypatch.chdir(folder)
    before = state_of(folder)
    if line.startswith("benchmarks."):
        module, _, line = line.partition(" ")
        outcome = run(line, command=importlib.import_module(module).command)
    else:
        outcome = run(line)
    assert (outcome.code, outcome.out) == (2, "")
    assert outcome.err.startswith("zeromethod: ")
    assert outcome.err.count("\n") == 1
    assert words in outcome.err
    assert state_of(folder) == before


def test_a_driver_that_leaves_the_program_anywhere_is_a_line_too():
    def leave() -> None:
        raise SystemExit(7)

    code, _, err = run(command=click.Command("x", callback=leave))
    assert code == 1
    assert err == "zeromethod: measurement failed: a driver ended the program (SystemExit: 7)\n"
