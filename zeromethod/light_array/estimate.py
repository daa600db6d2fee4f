"""One frame's numbers, compiled: readings and the levels that were lit to depth modes and the next levels."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from zeromethod.arrays import Float, Ints, Mask
from zeromethod.light_array.modes import Modes
from zeromethod.light_array.optics import COUNT, ArrayOptics
from zeromethod.light_array.rig import SIDE, LightArrayRig

_LEFT_OUT = 1e-4
"""Light of an LED, of what it gives where it is looked at, below which it does not count."""

_OUTLIER = 6.0
"""Residual, in robust standard deviations, from which a channel is not believed in a frame."""

_PASSES = 12
"""Steps of conjugate gradients for the next levels, at most; noise alone takes one."""

_PRIOR_LIGHT, _PRIOR_AMBIENT = 0.3, 0.1
"""Standard deviations of the LEDs' common brightness and of light from outside, against rest."""


class Model(NamedTuple):
    """What does not change during a run.

    fields: (6 * 256, modes) of `Modes.derivatives` where detectors look. along: (256,) how far along x a
    ray goes on per depth. tails: (256, reach + 1) of spots, by how many LEDs off, as far as they count.
    by_mode: (2, 256, modes) place looked at, LED pitches, per mode, at rest. off: (256, 2) LED pitches that
    are to be added. prior: (modes + 2,) 1 / variance of the state. sigma: noise of one reading.
    """

    fields: Float
    mirror: Float
    direction: Float
    along: Float
    face: Float
    first: Float
    pitch: float
    blur: Float
    tails: Float
    by_mode: Float
    off: Float
    prior: Float
    sigma: float


class Light(NamedTuple):
    """Where detectors look: nearest LED (256, 2), and the spots of the LEDs around it along and across."""

    near: Ints
    along: Float
    across: Float


class Look(NamedTuple):
    """Where detectors look: (256, 2) LED pitches, and what they see there."""

    place: Float
    light: Light


_DAMPING = 0.03
"""Square of the share of a pattern of levels that reaches detectors below which it takes several frames:
where the mirror gathers light, several detectors look at one LED, and it cannot show what all should."""


_COVERED = 0.75
"""Share of a detector's footprint on LEDs that give light from which it can be brought to rest."""


def model_of(rig: LightArrayRig) -> Model:
    """Model of a rig's optics and modes."""
    optics, modes = ArrayOptics.of(rig), Modes.of(rig)
    fields = modes.derivatives(optics.mirror_mm[:, :2])
    by_mode = place_by(optics, fields)
    count = fields.shape[2]
    prior = np.ones(count + 2)
    prior[count], prior[count + 1] = _PRIOR_LIGHT**-2, _PRIOR_AMBIENT**-2
    blur = optics.blur_mm / optics.pitch_mm
    reach = math.ceil(blur.max() * math.sqrt(-2 * math.log(_LEFT_OUT)) - 0.5)
    tails = np.exp(-(np.arange(reach + 1) ** 2) / (2 * blur[:, None] ** 2))
    return Model(
        fields.reshape(6 * COUNT, count), optics.mirror_mm, optics.direction,
        -optics.direction[:, 0] / optics.direction[:, 2],
        np.array([optics.led_edge_mm, optics.led_along, optics.led_normal]), optics.first_mm, optics.pitch_mm,
        blur, tails, by_mode, np.zeros((COUNT, 2)), prior, rig.detectors.noise,
    )  # fmt: skip


def place_by(optics: ArrayOptics, fields: Float) -> Float:
    """(2, 256, n) place looked at, LED pitches, by each of n surfaces of little depth.

    fields: (3 or more, 256, n) their depth and slopes where detectors look.
    """
    zero, step = np.zeros(COUNT), 1e-5
    changes = []
    for which in range(3):
        depth, slope = zero.copy(), np.zeros((COUNT, 2))
        for sign in (1, -1):
            (depth if which == 0 else slope[:, which - 1])[:] = sign * step
            place = optics.mirror_mm[:, :2] + np.outer(
                depth, [-optics.direction[0, 0] / optics.direction[0, 2], 0]
            )
            changes.append(optics.looked_at(depth, slope, place))
    by = [(changes[2 * k] - changes[2 * k + 1]) / (2 * step) for k in range(3)]
    return np.array([sum(by[k][:, axis, None] * fields[k] for k in range(3)) for axis in (0, 1)])


@numba.njit(cache=True)
def looked_at(model: Model, modes: Float) -> Float:
    """(256, 2) place on the LED plane that each detector looks at, LED pitches, by the mirror of modes."""
    field = model.fields @ modes
    place = np.empty((COUNT, 2))
    for k in range(COUNT):
        d0, dx, dy = field[k], field[COUNT + k], field[2 * COUNT + k]
        dxx, dxy = field[3 * COUNT + k], field[4 * COUNT + k]
        depth = d0
        for _ in range(3):
            on = model.along[k] * depth
            depth = d0 + on * (dx + on / 2 * dxx)
        on = model.along[k] * depth
        sx, sy = dx + on * dxx, dy + on * dxy
        px, py, pz = model.mirror[k, 0] + on, model.mirror[k, 1], -depth
        rx, ry, rz = model.direction[k, 0], model.direction[k, 1], model.direction[k, 2]
        into = 2 * (rx * sx + ry * sy + rz) / (sx * sx + sy * sy + 1)
        rx, ry, rz = rx - into * sx, ry - into * sy, rz - into
        face = model.face
        px, py, pz = px - face[0, 0], py - face[0, 1], pz - face[0, 2]
        reach = -(px * face[2, 0] + py * face[2, 1] + pz * face[2, 2])
        reach /= rx * face[2, 0] + ry * face[2, 1] + rz * face[2, 2]
        px, py, pz = px + reach * rx, py + reach * ry, pz + reach * rz
        on_face = px * face[1, 0] + py * face[1, 1] + pz * face[1, 2]
        place[k, 0] = (on_face - model.first[0]) / model.pitch + model.off[k, 0]
        place[k, 1] = (py - model.first[1]) / model.pitch + model.off[k, 1]
    return place


@numba.njit(cache=True)
def light_at(model: Model, place: Float) -> Light:
    """Spots of the LEDs around the places (256, 2) that detectors look at."""
    near, reach = np.empty((COUNT, 2), np.int64), model.tails.shape[1] - 1
    spots = np.empty((2, COUNT, 2 * reach + 1))
    for k in range(COUNT):
        square = model.blur[k] ** 2
        for axis in range(2):
            # a place far off the array is dark, whatever it is
            at = min(max(place[k, axis], -2.0 * SIDE), 3.0 * SIDE)
            near[k, axis] = round(at)
            off = at - near[k, axis]
            spot = spots[axis, k]
            spot[reach] = np.exp(-off * off / (2 * square)) / np.sqrt(2 * np.pi * square)
            up = down = spot[reach]
            rise, fall = np.exp(off / square), np.exp(-off / square)
            for j in range(1, reach + 1):
                up *= rise
                down *= fall
                spot[reach + j], spot[reach - j] = up * model.tails[k, j], down * model.tails[k, j]
    return Light(near, spots[0], spots[1])


@numba.njit(cache=True)
def look(model: Model, modes: Float) -> Look:
    """Where detectors look by the mirror of modes, and the LEDs' spots there."""
    place = looked_at(model, modes)
    return Look(place, light_at(model, place))


@numba.njit(cache=True, inline="always")
def _inside(near: int, reach: int) -> tuple[int, int]:
    """First of a window's spots that are on the array, and the one after the last."""
    return max(0, reach - near), min(2 * reach + 1, SIDE + reach - near)


@numba.njit(cache=True, fastmath=True)
def seen(light: Light, levels: Float) -> Float:
    """(256,) light that each detector sees of levels (256,)."""
    total, reach = np.zeros(COUNT), light.along.shape[1] // 2
    for k in range(COUNT):
        first, last = _inside(light.near[k, 0], reach)
        start, end = _inside(light.near[k, 1], reach)
        for j in range(start, end):
            at = (light.near[k, 1] - reach + j) * SIDE + light.near[k, 0] - reach
            part = 0.0
            for i in range(first, last):
                part += light.along[k, i] * levels[at + i]
            total[k] += light.across[k, j] * part
    return total


@numba.njit(cache=True, fastmath=True)
def light_by_place(model: Model, at: Look, levels: Float) -> tuple[Float, Float]:
    """(256,) light that each detector sees, and (2, 256) how it changes with the place looked at.

    The second in sigmas of a reading per LED pitch.
    """
    place, light = at
    total, by_place, reach = np.zeros(COUNT), np.empty((2, COUNT)), light.along.shape[1] // 2
    for k in range(COUNT):
        first, last = _inside(light.near[k, 0], reach)
        start, end = _inside(light.near[k, 1], reach)
        left, below = light.near[k, 0] - reach, light.near[k, 1] - reach
        along = across = 0.0
        for j in range(start, end):
            part = slope = 0.0
            for i in range(first, last):
                one = light.along[k, i] * levels[(below + j) * SIDE + left + i]
                part += one
                slope += (left + i - place[k, 0]) * one
            total[k] += light.across[k, j] * part
            along += light.across[k, j] * slope
            across += light.across[k, j] * (below + j - place[k, 1]) * part
        weight = 1 / (model.blur[k] ** 2 * model.sigma)
        by_place[0, k], by_place[1, k] = weight * along, weight * across
    return total, by_place


@numba.njit(cache=True, fastmath=True)
def _back(light: Light, values: Float) -> Float:
    """(256,) the transpose of `seen`."""
    total, reach = np.zeros(COUNT), light.along.shape[1] // 2
    for k in range(COUNT):
        if values[k] != 0.0:
            first, last = _inside(light.near[k, 0], reach)
            start, end = _inside(light.near[k, 1], reach)
            for j in range(start, end):
                at = (light.near[k, 1] - reach + j) * SIDE + light.near[k, 0] - reach
                part = light.across[k, j] * values[k]
                for i in range(first, last):
                    total[at + i] += light.along[k, i] * part
    return total


@numba.njit(cache=True)
def correction(light: Light, missing: Float, gain: Float, sigma: float) -> Float:
    """(256,) change of levels that adds the light `missing` (256,) at the detectors, within its noise sigma.

    gain: (256,) of each LED, 0 for none.
    """
    change = np.zeros(COUNT)
    left = missing.copy()
    slope = gain * _back(light, left)
    along = slope.copy()
    size = slope @ slope
    enough = sigma * sigma * np.sum(light.along * light.along) * np.sum(light.across * light.across) / COUNT
    for done in range(_PASSES):
        if size <= (enough if done else 0.0):
            break
        adds = seen(light, gain * along)
        for k in range(COUNT):
            if missing[k] == 0.0:
                adds[k] = 0.0
        step = size / (adds @ adds + _DAMPING * (along @ along))
        change += step * along
        left -= step * adds
        slope = gain * _back(light, left) - _DAMPING * change
        before, size = size, slope @ slope
        along = slope + size / before * along
    return change


@numba.njit(cache=True)
def next_levels(
    light: Light, missing: Float, gain: Float, shown: Float, newest: Float, share: float, sigma: float
) -> tuple[Float, float, float]:
    """Levels (256,) that bring detectors to rest, what they can still add to a frame, and what it lacks, rms.

    Detectors that look beyond the LEDs, or at dead ones, are not counted: nothing brings them to rest.

    missing: (256,) light at the detectors, 0 where one is not used. gain: of the LEDs, 0 for those left out.
    shown, newest: levels of the frame, and those sent last, whose light is on its way. share: of a correction
    that is applied.
    """
    covered = seen(light, np.where(gain > 0.0, 1.0, 0.0)) > _COVERED
    missing = np.where(covered, missing, 0.0)
    lacks = missing - np.where(missing != 0.0, seen(light, gain * (newest - shown)), 0.0)
    change = correction(light, lacks, gain, sigma)
    stuck = ((newest <= 0.0) & (change < 0.0)) | ((newest >= 1.0) & (change > 0.0))
    if stuck.any():  # what LEDs at their limit cannot give, the others around them may
        change = correction(light, lacks, np.where(stuck, 0.0, gain), sigma)
    whole = np.minimum(np.maximum(newest + change, 0.0), 1.0)
    adds = np.where(missing != 0.0, seen(light, gain * (whole - shown)), 0.0)
    wanted = np.minimum(np.maximum(newest + share * change, 0.0), 1.0)
    used = max(1.0, np.count_nonzero(missing) * 1.0)
    could, residual = math.sqrt(adds @ adds / used), math.sqrt(missing @ missing / used)
    return np.where(gain > 0.0, wanted, 0.0), could, residual


class Fit(NamedTuple):
    """What a frame says. state: after the step; look: by it. left: (256,) residual after it, in sigmas.

    moved: largest change of a place by the step, LED pitches. scale: robust size of `left`, 1 for noise
    alone.
    """

    state: Float
    look: Look
    left: Float
    moved: float
    scale: float


@numba.njit(cache=True)
def fit(
    model: Model,
    state: Float,
    at: Look,
    covariance: Float,
    fresh: bool,
    lit: Float,
    offset: Float,
    reading: Float,
    used: Mask,
) -> Fit:
    """Step of Gauss and Newton from `state` (modes, then brightness and light from outside), by one frame.

    at: by the state. covariance: of the state, (n, n), renewed in place where `fresh`. lit: (256,) levels by
    the LEDs' gains. offset: (256,) what readings have at rest that the model has not. reading: (256,). used:
    which of them count.
    """
    count = len(state) - 2
    bright = 1 + state[count]
    total, by_place = light_by_place(model, at, lit)
    jacobian, left = np.empty((COUNT, count + 2)), np.empty(COUNT)
    for k in range(COUNT):
        by_u, by_v = bright * by_place[0, k], bright * by_place[1, k]
        left[k] = (reading[k] - offset[k] - bright * total[k] - state[count + 1]) / model.sigma
        on = 1.0 if used[k] else 0.0
        for j in range(count):
            jacobian[k, j] = on * (by_u * model.by_mode[0, k, j] + by_v * model.by_mode[1, k, j])
        jacobian[k, count] = on * total[k] / model.sigma
        jacobian[k, count + 1] = on / model.sigma
    if fresh:
        information = jacobian.T @ jacobian
        for j in range(count + 2):
            information[j, j] += model.prior[j]
        covariance[:] = np.linalg.inv(information)
    step = covariance @ (jacobian.T @ left - model.prior * state)
    rest = left - jacobian @ step
    for k in range(COUNT):
        if not used[k]:  # its own residual all the same: it may have come back
            rest[k] = left[k]
    moved = max(np.abs(model.by_mode[0] @ step[:count]).max(), np.abs(model.by_mode[1] @ step[:count]).max())
    state = state + step
    return Fit(state, look(model, state[:count]), rest, moved, 1.4826 * np.median(np.abs(rest)[used]))
