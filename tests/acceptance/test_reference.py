"""Frames recorded with 0.1.0 give the warps and depths that they gave then.

`tests/data/reference.npz` holds a seeded run on the packaged bench of 160 x 128 camera px, its coded strips
included: every frame, every picture shown, and what 0.1.0 made of them while a soft pad came down and slid.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from small_rigs import BENCH_160, small_rig_file

from zeromethod.devices.protocols import Frame
from zeromethod.loop.assembly import make_circle
from zeromethod.optics import Optics
from zeromethod.rig.load import load_rig
from zeromethod.surface import SurfaceReader

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
    pictures = zip(
        reference["pic_before_frame"],
        reference["pic_time_ns"],
        reference["pic_q"],
        reference["pic_code"],
        reference["pic_seen_ns"],
        strict=True,
    )
    pending = list(pictures)
    measured = 0
    for index, image in enumerate(reference["image"]):
        while pending and pending[0][0] <= index:
            _, time_ns, q, code, source_ns = pending.pop(0)
            circle.presented(
                int(time_ns),
                q,
                None if code < 0 else int(code),
                source_ns=None if source_ns < 0 else int(source_ns),
            )
        frame = Frame(
            image,
            int(reference["frame_time_ns"][index]),
            int(reference["exposure_ns"][index]),
            int(reference["number"][index]),
        )
        warp = circle.take(frame).measured
        if warp is None:
            assert np.isnan(reference["measured_q"][index]).all()
            continue
        measured += 1
        np.testing.assert_array_equal(warp.flags, reference["flags"][index])
        # LCD px: far below the noise of 0.008, far above the last bits of other processors' arithmetic
        np.testing.assert_allclose(warp.q, reference["measured_q"][index], rtol=0, atol=1e-6)
        np.testing.assert_allclose(circle.controller.commanded, reference["commanded_q"][index], atol=1e-6)
        depth_mm = reader.read(warp).depth_mm
        np.testing.assert_allclose(depth_mm, reference["depth_mm"][index], rtol=0, atol=1e-7)
    assert measured >= 24
