"""The page of a rig with a projector: what is projected, and the fingers in it."""

import time

from browsing import CALM_CAMERA, browser, needs_browser, served, tab
from small_rigs import BENCH_320, small_rig_file

pytestmark = needs_browser
PATIENCE_S = 60.0
HELD = """
duration_s = 900.0
[[object]]
shape = "ball"
radius_mm = 30.0
path = [
    { time_s = 0.3, x_mm = 45.0, y_mm = 3.0, force_n = 0.0 },
    { time_s = 0.35, x_mm = 45.0, y_mm = 3.0, force_n = 0.5 },
    { time_s = 890.0, x_mm = 45.0, y_mm = 3.0, force_n = 0.5 },
]
"""
RINGS = """() => { const c = document.getElementById('projector-canvas');
    const d = new Uint32Array(c.getContext('2d').getImageData(0, 0, c.width, c.height).data.buffer);
    const grey = (one) => [0, 8, 16].every((bit) => ((one >> bit) & 255) > 150);
    return [d.filter((one) => one === 0xffd56aff).length, d.filter(grey).length]; }"""
"""Pixels of the colour that pointers are drawn in, and bright ones: the ring that is projected."""


def test_what_is_projected_is_shown_with_the_finger_that_is_down(tmp_path):
    (tmp_path / "calm.py").write_text(CALM_CAMERA)
    (tmp_path / "held.toml").write_text(HELD)
    own = {"camera.driver": "calm:CalmCamera", "cloth.weave_mm": 0.6}
    rig = small_rig_file(tmp_path / "small.toml", BENCH_320 | own, "interactive")
    words = ("--scenario", "held.toml", "--seconds", "900", "--view", "127.0.0.1:0")
    with (
        served("run", "--rig", rig, *words, cwd=tmp_path, wanted=2) as one,
        browser() as chromium,
        tab(chromium, one.urls["view"]) as page,
    ):
        end_s = time.monotonic() + PATIENCE_S
        while not page.evaluate("zeromethod.values.pointers?.length > 0"):
            assert time.monotonic() < end_s
            page.wait_for_timeout(50)
        page.click("[data-tab='projector-tab']")
        while min(seen := page.evaluate(RINGS)) < 20:
            assert time.monotonic() < end_s, seen
            page.wait_for_timeout(50)
