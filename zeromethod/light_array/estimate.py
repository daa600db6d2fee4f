"""What one frame says: readings and the levels that were lit to depth modes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.kernels import kernel, read
from zeromethod.light_array.modes import Modes
from zeromethod.light_array.optics import COUNT, ArrayOptics
from zeromethod.light_array.rig import SIDE, LightArrayRig
from zeromethod.rounding import REORDERED

_LEFT_OUT = 1e-4
"""Light of an LED, relative to one looked at directly, below which it is left out."""

_PRIOR_LIGHT, _PRIOR_AMBIENT = 0.3, 0.1
"""Standard deviations of the LEDs' common brightness, relative to rest, and of light from outside."""

_STEP = 1e-5
"""Depth, mm, and slope by which the change of a place looked at is worked out."""


class Model(NamedTuple):
    """What does not change during a run.

    fields: (6 * 256, modes) of `Modes.derivatives` where detectors look. by_mode: (2, 256, modes) change of
    the place looked at per mode, at rest, LED pitches. reach: so many LEDs to each side of a place count.
    off: (256, 2) by how much detectors look elsewhere than the rig file says, LED pitches. prior:
    (modes + 2,) 1 / variance of the state (see `fit`). sigma: noise of one reading, of full scale.
    """

    optics: ArrayOptics
    fields: Float
    by_mode: Float
    reach: int
    off: Float
    prior: Float
    sigma: float


class Look(NamedTuple):
    """Where detectors look, and what they see there: of LED (row, column) across[row] * along[column].

    place: (256, 2) LED pitches, 0 at LED 0. along, across: (256, 16).
    """

    place: Float
    along: Float
    across: Float


def model_of(rig: LightArrayRig) -> Model:
    """Model of a rig's optics and modes."""
    optics = ArrayOptics.of(rig)
    fields = Modes.of(rig).derivatives(optics.mirror_mm[:, :2])
    count = fields.shape[2]
    prior = np.array([*np.ones(count), _PRIOR_LIGHT**-2, _PRIOR_AMBIENT**-2])
    reach = math.ceil(optics.blur.max() * math.sqrt(-2 * math.log(_LEFT_OUT)) - 0.5)
    by_mode, off = place_by(optics, fields), np.zeros((COUNT, 2))
    return Model(optics, fields.reshape(-1, count), by_mode, reach, off, prior, rig.detectors.noise)


def place_by(optics: ArrayOptics, fields: Float) -> Float:
    """(2, 256, n) change of the places looked at, LED pitches, by each of n surfaces of little depth.

    fields: (3 or more, 256, n) their depth and slopes where detectors look.
    """
    change = np.zeros((2, COUNT, fields.shape[2]))
    for which in range(3):
        field = np.zeros((6, COUNT))
        field[which] = _STEP
        by = (looked_at(optics, field) - looked_at(optics, -field)) / (2 * _STEP)
        change += by.T[:, :, None] * fields[which]
    return change


def looked_at(optics: ArrayOptics, field: Float) -> Float:
    """(256, 2) place on the LED plane that each detector looks at, LED pitches.

    field: (6, 256) depth of the mirror and its derivatives, as of `Modes.derivatives`, where they look at
    rest.
    """
    return _look_of(optics, field, np.zeros((COUNT, 2)), 0).place


def look(model: Model, modes: Float) -> Look:
    """Where detectors look by the mirror of modes, and what they see of the LEDs there."""
    field = (model.fields @ modes).reshape(6, COUNT)
    return _look_of(model.optics, field, model.off, model.reach)


def _look_of(optics: ArrayOptics, field: Float, off: Float, reach: int) -> Look:
    at = Look(np.empty((COUNT, 2)), np.zeros((COUNT, SIDE)), np.zeros((COUNT, SIDE)))
    _look(*optics, field, off, reach, *at)
    return at


@kernel(
    read(numba.float64, 2),
    read(numba.float64, 1),
    read(numba.float64, 2),
    read(numba.float64, 1),
    numba.float64,
    read(numba.float64, 1),
    read(numba.float64, 2),
    read(numba.float64, 2),
    numba.int64,
    numba.float64[:, ::1],
    numba.float64[:, ::1],
    numba.float64[:, ::1],
)
def _look(
    mirror_mm: Float,
    direction: Float,
    face: Float,
    first_mm: Float,
    pitch_mm: float,
    blur: Float,
    field: Float,
    off: Float,
    reach: int,
    place: Float,
    along: Float,
    across: Float,
) -> None:
    """Trace the detectors' rays by the mirror to the LED plane; enter in `Look`, 0 before, what they see.

    The first six as of `ArrayOptics`, the others as of `looked_at` and `Model`.
    """
    forth = -direction[0] / direction[2]
    for k in range(COUNT):
        d0, dx, dy, dxx, dxy = field[0, k], field[1, k], field[2, k], field[3, k], field[4, k]
        depth = d0
        for _ in range(3):  # a ray goes on along x until it meets the dented mirror
            on = forth * depth
            depth = d0 + on * (dx + on / 2 * dxx)
        on = forth * depth
        sx, sy = dx + on * dxx, dy + on * dxy
        px, py, pz = mirror_mm[k, 0] + on, mirror_mm[k, 1], -depth
        rx, ry, rz = direction[0], direction[1], direction[2]
        into = 2 * (rx * sx + ry * sy + rz) / (sx * sx + sy * sy + 1)
        rx, ry, rz = rx - into * sx, ry - into * sy, rz - into
        px, py, pz = px - face[0, 0], py - face[0, 1], pz - face[0, 2]
        way = -(px * face[2, 0] + py * face[2, 1] + pz * face[2, 2])
        way /= rx * face[2, 0] + ry * face[2, 1] + rz * face[2, 2]
        px, py, pz = px + way * rx, py + way * ry, pz + way * rz
        on_face = px * face[1, 0] + py * face[1, 1] + pz * face[1, 2]
        place[k, 0] = (on_face - first_mm[0]) / pitch_mm + off[k, 0]
        place[k, 1] = (py - first_mm[1]) / pitch_mm + off[k, 1]
        square = blur[k] ** 2
        peak, decay = 1 / math.sqrt(2 * math.pi * square), math.exp(-1 / square)
        for axis in range(2):
            spots = across if axis else along
            # a place far off the array is dark, whatever it is
            at = min(max(place[k, axis], -2.0 * SIDE), 3.0 * SIDE)
            first, last = max(round(at) - reach, 0), min(round(at) + reach, SIDE - 1)
            # a Gaussian from LED to LED, by products: exponentials would take longest
            left = first - at
            spot = peak * math.exp(-left * left / (2 * square))
            ratio = math.exp(-(2 * left + 1) / (2 * square))
            for led in range(first, last + 1):
                spots[k, led] = spot
                spot *= ratio
                ratio *= decay


@kernel(
    read(numba.float64, 2),
    read(numba.float64, 2),
    read(numba.float64, 2),
    read(numba.float64, 2),
    numba.float64[::1],
    numba.float64[:, ::1],
    fastmath=REORDERED,
)
def _light(place: Float, along: Float, across: Float, levels: Float, total: Float, by_place: Float) -> None:
    """Light that each detector sees of levels (16, 16), and (2, 256) its change by place, times blur^2."""
    for k in range(COUNT):
        total[k] = by_place[0, k] = by_place[1, k] = 0.0
        for row in range(SIDE):
            share = across[k, row]
            if share != 0.0:
                light = moment = 0.0
                for column in range(SIDE):
                    one = along[k, column] * levels[row, column]
                    light += one
                    moment += column * one
                total[k] += share * light
                by_place[0, k] += share * moment
                by_place[1, k] += row * share * light
        by_place[0, k] -= place[k, 0] * total[k]
        by_place[1, k] -= place[k, 1] * total[k]


def _seen_by_place(at: Look, levels: Float) -> tuple[Float, Float]:
    total, by_place = np.empty(COUNT), np.empty((2, COUNT))
    _light(*at, levels.reshape(SIDE, SIDE), total, by_place)
    return total, by_place


def seen(at: Look, levels: Float) -> Float:
    """(256,) light that each detector sees of levels (256,)."""
    return _seen_by_place(at, levels)[0]


def each_led(at: Look) -> Float:
    """(detectors, LEDs) light that each detector sees of each LED at full level, alone."""
    return (at.across[:, :, None] * at.along[:, None, :]).reshape(COUNT, COUNT)


def light_by_place(model: Model, at: Look, levels: Float) -> tuple[Float, Float]:
    """(256,) light that each detector sees, and (2, 256) its change with the place looked at.

    The second in sigmas of a reading per LED pitch.
    """
    total, by_place = _seen_by_place(at, levels)
    by_place /= model.optics.blur**2 * model.sigma
    return total, by_place


class Fit(NamedTuple):
    """What a frame says.

    state: after the step; look: by that state. left: (256,) residual after the step, in sigmas of a reading,
    of detectors that are not used, too: they may have come back. moved: largest change of a place that a
    detector in use looks at, LED pitches. scale: robust size of `left`, 1 for noise alone.
    """

    state: Float
    look: Look
    left: Float
    moved: float
    scale: float


def fit(
    model: Model, state: Float, at: Look, covariance: Float, fresh: bool, lit: Float, offset: Float,
    reading: Float, used: Mask,
) -> Fit:  # fmt: skip
    """One Gauss-Newton step by one frame.

    state: (modes + 2,) modes, change of the LEDs' common brightness, light from outside. at: where detectors
    look in that state. covariance: of the state, (n, n), computed again in place if `fresh`. lit: (256,)
    levels times the LEDs' gains. offset: (256,) light at rest that the model lacks. reading: (256,) light.
    used: (256,) the detectors that count.
    """
    count = len(state) - 2
    bright, on = 1 + state[count], np.where(used, 1.0, 0.0)
    total, by_place = light_by_place(model, at, lit)
    left = (reading - offset - bright * total - state[count + 1]) / model.sigma
    jacobian = np.empty((COUNT, count + 2))
    np.einsum("ak,akj->kj", on * bright * by_place, model.by_mode, out=jacobian[:, :count])
    jacobian[:, count], jacobian[:, count + 1] = on * total / model.sigma, on / model.sigma
    if fresh:
        covariance[:] = np.linalg.inv(jacobian.T @ jacobian + np.diag(model.prior))
    step = covariance @ (jacobian.T @ left - model.prior * state)
    left = left - jacobian @ step
    # where no detector is used, noise moves the modes as it likes
    moved = float(np.abs(on * (model.by_mode @ step[:count])).max())
    state = state + step
    return Fit(state, look(model, state[:count]), left, moved, _scale(left[used]))


def _scale(left: Float) -> float:
    """Robust standard deviation; NaN of nothing. Sorted: `np.median` takes several times as long."""
    size, count = np.sort(np.abs(left)), len(left)
    return float(1.4826 * 0.5 * (size[(count - 1) // 2] + size[count // 2])) if count else math.nan
