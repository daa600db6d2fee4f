"""Frames recorded with 0.1.0 give the warps and depths of the reference.

`tests/data/reference.npz` holds a seeded run on the packaged bench of 160 x 128 camera px, its coded strips
included: every frame and every picture shown while a soft pad came down and slid. Warps and depths are those
of 0.1.0 less what the blur of the panel's apertures had added (4e-4 LCD px, 7 nm of 60 um, at most), and less
depth's constant, which is no matter of pictures: by formula as this pad is, no loads make its dent, and the
constant is up to 3 um off. That moves nodes over the mirror, and changes depths by 0.23 % of it. The light
of frames at rest is learned, as the loop does: 0.003 LCD px of a command and 25 nm of a depth, at most.
"""

from pathlib import Path

import numpy as np
import pytest
from small_rigs import BENCH_160, small_rig_file

from zeromethod import Optics, SurfaceReader, load_rig
from zeromethod.devices.protocols import Frame
from zeromethod.loop.assembly import make_circle

PRESSED_FROM = 5
REFERENCE = Path(__file__).parents[1] / "data" / "reference.npz"


@pytest.fixture(scope="module")
def reference() -> dict[str, np.ndarray]:
    with np.load(REFERENCE) as data:
        return dict(data)


def test_recorded_frames_give_the_warps_and_depths_of_the_reference(reference, tmp_path):
    rig = load_rig(small_rig_file(tmp_path / "rig.toml", BENCH_160))
    optics = Optics(rig)
    circle = make_circle(rig, optics).circle
    reader = SurfaceReader(rig, optics, circle.rest.grid)
    names = ("pic_before_frame", "pic_time_ns", "pic_q", "pic_code", "pic_seen_ns")
    pending = list(zip(*(reference[name] for name in names), strict=True))
    names = ("frame_time_ns", "exposure_ns", "number")
    stamps = zip(*(reference[name].tolist() for name in names), strict=True)
    measured = 0
    for index, (image, stamp) in enumerate(zip(reference["image"], stamps, strict=True)):
        while pending and pending[0][0] <= index:
            _, time_ns, q, *numbers = pending.pop(0)
            code, source_ns = (None if number < 0 else int(number) for number in numbers)
            circle.presented(int(time_ns), q, code, source_ns=source_ns)
        frame = Frame(image, *stamp)
        result = circle.take(frame)
        warp = result.measured
        if index < PRESSED_FROM:
            circle.learn_rest(result)
        if warp is None:
            assert np.isnan(reference["measured_q"][index]).all()
            continue
        measured += 1
        np.testing.assert_array_equal(warp.flags, reference["flags"][index])
        # LCD px: far below the noise of 0.008, far above the last bits of other processors' arithmetic
        np.testing.assert_allclose(warp.q, reference["measured_q"][index], rtol=0, atol=1e-6)
        np.testing.assert_allclose(circle.controller.commanded, reference["commanded_q"][index], atol=1e-6)
        off = (reader.read(warp).depth_mm - reference["depth_mm"][index])[circle.rest.grid.inner]
        off /= reader.scale
        constant_mm = np.nanmean(off)
        np.testing.assert_allclose(off, constant_mm, rtol=0, atol=1e-7 + 2.5e-3 * abs(constant_mm))
    assert measured >= 24
