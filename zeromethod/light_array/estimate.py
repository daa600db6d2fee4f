"""One frame's numbers, compiled: readings and the levels that were lit to depth modes and the next levels."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.light_array.modes import Modes
from zeromethod.light_array.optics import COUNT, ArrayOptics
from zeromethod.light_array.rig import SIDE, LightArrayRig

_LEFT_OUT = 1e-4
"""Light of an LED, relative to one looked at directly, below which it is left out."""

_PASSES = 12
"""Steps of conjugate gradients for the next levels, at most; noise alone takes one."""

_PRIOR_LIGHT, _PRIOR_AMBIENT = 0.3, 0.1
"""Standard deviations of the LEDs' common brightness, relative to rest, and of light from outside."""

_DAMPING = 0.03
"""Patterns of levels of which less than the root of this share reaches the detectors take several frames:
where the mirror gathers light, several detectors look at one LED, and it cannot show what all should."""

_COVERED = 0.75
"""Share of what a detector looks at that working LEDs must cover, so that levels can null it."""

_STEP = 1e-5
"""Depth, mm, and slope by which the change of a place looked at is worked out."""

_LEDS = np.arange(float(SIDE))


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


@numba.njit(cache=True)
def looked_at(optics: ArrayOptics, field: Float) -> Float:
    """(256, 2) place on the LED plane that each detector looks at, LED pitches.

    field: (6, 256) depth of the mirror and its derivatives, as of `Modes.derivatives`, where they look at
    rest.
    """
    place, face = np.empty((COUNT, 2)), optics.led_face
    along = -optics.direction[0] / optics.direction[2]
    for k in range(COUNT):
        d0, dx, dy, dxx, dxy = field[0, k], field[1, k], field[2, k], field[3, k], field[4, k]
        depth = d0
        for _ in range(3):  # a ray goes on along x until it meets the dented mirror
            on = along * depth
            depth = d0 + on * (dx + on / 2 * dxx)
        on = along * depth
        sx, sy = dx + on * dxx, dy + on * dxy
        px, py, pz = optics.mirror_mm[k, 0] + on, optics.mirror_mm[k, 1], -depth
        rx, ry, rz = optics.direction
        into = 2 * (rx * sx + ry * sy + rz) / (sx * sx + sy * sy + 1)
        rx, ry, rz = rx - into * sx, ry - into * sy, rz - into
        px, py, pz = px - face[0, 0], py - face[0, 1], pz - face[0, 2]
        reach = -(px * face[2, 0] + py * face[2, 1] + pz * face[2, 2])
        reach /= rx * face[2, 0] + ry * face[2, 1] + rz * face[2, 2]
        px, py, pz = px + reach * rx, py + reach * ry, pz + reach * rz
        on_face = px * face[1, 0] + py * face[1, 1] + pz * face[1, 2]
        place[k, 0] = (on_face - optics.first_mm[0]) / optics.pitch_mm
        place[k, 1] = (py - optics.first_mm[1]) / optics.pitch_mm
    return place


@numba.njit(cache=True)
def look(model: Model, modes: Float) -> Look:
    """Where detectors look by the mirror of modes, and what they see of the LEDs there."""
    place = looked_at(model.optics, (model.fields @ modes).reshape(6, COUNT)) + model.off
    spots = np.zeros((2, COUNT, SIDE))
    for k in range(COUNT):
        square = model.optics.blur[k] ** 2
        peak, decay = 1 / math.sqrt(2 * math.pi * square), math.exp(-1 / square)
        for axis in range(2):
            # a place far off the array is dark, whatever it is
            at = min(max(place[k, axis], -2.0 * SIDE), 3.0 * SIDE)
            first, last = max(round(at) - model.reach, 0), min(round(at) + model.reach, SIDE - 1)
            # a Gaussian from LED to LED, by products: exponentials would take longest
            off = first - at
            spot = peak * math.exp(-off * off / (2 * square))
            ratio = math.exp(-(2 * off + 1) / (2 * square))
            for led in range(first, last + 1):
                spots[axis, k, led] = spot
                spot *= ratio
                ratio *= decay
    return Look(place, spots[0], spots[1])


@numba.njit(cache=True, fastmath=True)
def _row_sums(one: Float, other: Float) -> Float:
    """(256,) sums over each row of a product (256, 16)."""
    total = np.empty(COUNT)
    for k in range(COUNT):
        row = 0.0
        for j in range(SIDE):
            row += one[k, j] * other[k, j]
        total[k] = row
    return total


@numba.njit(cache=True)
def seen(at: Look, levels: Float) -> Float:
    """(256,) light that each detector sees of levels (256,)."""
    return _row_sums(at.across, at.along @ levels.reshape(SIDE, SIDE).T)


@numba.njit(cache=True)
def _back(at: Look, values: Float) -> Float:
    """(256,) the transpose of `seen`: how much each LED adds to values (256,) of the detectors."""
    return ((at.across * values.reshape(COUNT, 1)).T @ at.along).reshape(COUNT)


def each_led(at: Look) -> Float:
    """(detectors, LEDs) light that each detector sees of each LED at full level, alone."""
    return (at.across[:, :, None] * at.along[:, None, :]).reshape(COUNT, COUNT)


@numba.njit(cache=True)
def light_by_place(model: Model, at: Look, levels: Float) -> tuple[Float, Float]:
    """(256,) light that each detector sees, and (2, 256) its change with the place looked at.

    The second in sigmas of a reading per LED pitch.
    """
    along, across = at.along, at.across
    by_column = levels.reshape(SIDE, SIDE).T
    rows, moments = along @ by_column, (along * _LEDS) @ by_column
    total = _row_sums(across, rows)
    by_u = _row_sums(across, moments) - at.place[:, 0] * total
    by_v = _row_sums(across * _LEDS, rows) - at.place[:, 1] * total
    weight, by_place = 1 / (model.optics.blur**2 * model.sigma), np.empty((2, COUNT))
    by_place[0], by_place[1] = weight * by_u, weight * by_v
    return total, by_place


@numba.njit(cache=True)
def correction(at: Look, missing: Float, gain: Float, sigma: float) -> Float:
    """(256,) change of levels that adds the light `missing` (256,) at the detectors, within its noise sigma.

    gain: (256,) of each LED, 0 for none.
    """
    change = np.zeros(COUNT)
    left = missing.copy()
    slope = gain * _back(at, left)
    along = slope.copy()
    size = slope @ slope
    along_flat, across_flat = at.along.reshape(-1), at.across.reshape(-1)
    enough = sigma * sigma * (along_flat @ along_flat) * (across_flat @ across_flat) / COUNT
    for done in range(_PASSES):
        if size <= (enough if done else 0.0):
            break
        adds = np.where(missing != 0.0, seen(at, gain * along), 0.0)
        step = size / (adds @ adds + _DAMPING * (along @ along))
        change += step * along
        left -= step * adds
        slope = gain * _back(at, left) - _DAMPING * change
        before, size = size, slope @ slope
        along = slope + size / before * along
    return change


@numba.njit(cache=True)
def next_levels(
    at: Look, missing: Float, gain: Float, shown: Float, newest: Float, share: float, sigma: float
) -> tuple[Float, float, float]:
    """Levels (256,) that bring detectors to rest, what they can still add to a frame, and what it lacks, rms.

    Detectors that look beyond the LEDs, or at dead ones, are not counted: nothing brings them to rest.

    missing: (256,) light at the detectors, 0 where one is not used. gain: of the LEDs, 0 for those left out.
    shown, newest: levels lit in the frame, and those sent last, whose light is on its way. share: of a
    correction that is applied.
    """
    covered = seen(at, np.where(gain > 0.0, 1.0, 0.0)) > _COVERED
    missing = np.where(covered, missing, 0.0)
    lacks = missing - np.where(missing != 0.0, seen(at, gain * (newest - shown)), 0.0)
    change = correction(at, lacks, gain, sigma)
    stuck = ((newest <= 0.0) & (change < 0.0)) | ((newest >= 1.0) & (change > 0.0))
    if stuck.any():  # what LEDs at their limit cannot give, the others around them may
        change = correction(at, lacks, np.where(stuck, 0.0, gain), sigma)
    whole = np.minimum(np.maximum(newest + change, 0.0), 1.0)
    adds = np.where(missing != 0.0, seen(at, gain * (whole - shown)), 0.0)
    wanted = np.minimum(np.maximum(newest + share * change, 0.0), 1.0)
    used = max(1.0, np.count_nonzero(missing) * 1.0)
    could, residual = math.sqrt(adds @ adds / used), math.sqrt(missing @ missing / used)
    return np.where(gain > 0.0, wanted, 0.0), could, residual


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


@numba.njit(cache=True)
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
    by_u, by_v = on * bright * by_place[0], on * bright * by_place[1]
    for k in range(COUNT):
        for j in range(count):
            jacobian[k, j] = by_u[k] * model.by_mode[0, k, j] + by_v[k] * model.by_mode[1, k, j]
    jacobian[:, count], jacobian[:, count + 1] = on * total / model.sigma, on / model.sigma
    if fresh:
        covariance[:] = np.linalg.inv(jacobian.T @ jacobian + np.diag(model.prior))
    step = covariance @ (jacobian.T @ left - model.prior * state)
    left = left - jacobian @ step
    # where no detector is used, noise moves the modes as it likes
    by_u, by_v = on * (model.by_mode[0] @ step[:count]), on * (model.by_mode[1] @ step[:count])
    moved = max(np.abs(by_u).max(), np.abs(by_v).max())
    state = state + step
    return Fit(state, look(model, state[:count]), left, moved, 1.4826 * np.median(np.abs(left)[used]))
