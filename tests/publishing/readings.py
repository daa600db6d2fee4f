"""Readings of planted depth, and what a subscriber makes of messages."""

import json
from typing import Any

import numpy as np

from zeromethod import Event, State, Step
from zeromethod.surface import Anchor, Peak, Surface, peak
from zeromethod.warp.warp import Role, Warp

SHAPE = (30, 40)
SIGMA_MM = 1e-4
DENT_MM = 3.0
"""Width of the dent (one sigma): six nodes, from where on the peak's fit is within 0.01 %."""
TOPIC = b"zeromethod.v2\n"


def dent(
    depth_mm: float = 0.0,
    time_ns: int = 0,
    *,
    shape: tuple[int, int] = SHAPE,
    sigma_mm: float = SIGMA_MM,
    dark: tuple[slice, slice] | None = None,
    generator: np.random.Generator | None = None,
) -> tuple[Surface, Peak]:
    """A Gaussian dent in the middle of nodes 0.5 mm apart, with a padding of two that is not read."""
    y, x = 0.5 * np.indices(shape, dtype=np.float64)
    centre = (x.mean(), y.mean())
    depth = depth_mm * np.exp(-0.5 * ((x - centre[0]) ** 2 + (y - centre[1]) ** 2) / DENT_MM**2)
    if generator is not None:
        depth = depth + sigma_mm * generator.standard_normal(shape)
    slope = np.stack([-(x - centre[0]) * depth, -(y - centre[1]) * depth], axis=-1) / DENT_MM**2
    valid, contact = np.zeros(shape, bool), np.zeros(shape, bool)
    valid[2:-2, 2:-2] = True
    if dark is not None:
        contact[dark], valid[dark] = True, False
    depth[~valid], slope[~valid] = np.nan, np.nan
    sigma = np.where(valid, sigma_mm, np.nan)
    anchor = Anchor("loads", np.zeros(shape, bool), 0.0)
    both = np.stack([sigma, sigma], axis=-1)
    surface = Surface(depth, slope, x, y, sigma, both, valid, contact, anchor, time_ns, 3)
    return surface, peak(surface)


def a_step(
    number: int,
    reading: tuple[Surface, Peak] | None = None,
    *,
    time_ns: int = 0,
    state: State = State.LOCKED,
    **more: Any,
) -> Step:
    """One step of the loop, with its surface and peak; what is not published is empty."""
    nothing = Warp.drawn(np.zeros((1, 1, 2)), Role.COMMANDED, time_ns)
    if reading is not None:
        more |= {"surface": reading[0], "peak": reading[1]}
    return Step(
        number=number,
        time_ns=time_ns,
        time_s=1e-9 * time_ns,
        state=state,
        reason="as planted",
        events=(Event.FRAMES_DROPPED,),
        commanded=nothing,
        filtered=nothing,
        **more,
    )


def decoded(message: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and maps of a message, refusing JSON that is none (NaN, Infinity)."""

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    assert message.startswith(TOPIC)
    header_line, data = message.removeprefix(TOPIC).split(b"\n", 1)
    header = json.loads(header_line, parse_constant=refuse)
    maps = {
        a["name"]: np.ndarray(a["shape"], a["dtype"], data, a["offset"], order=a["order"])
        for a in header["arrays"]
    }
    assert len(data) == sum(values.nbytes for values in maps.values())
    return header, maps
