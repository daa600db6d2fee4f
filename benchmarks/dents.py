"""Dents of many profiles in closed form, round or long: more than the simulated bench presses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float
from zeromethod.simulation.shapes import ball, cone, edge, gaussian

Profile = Callable[[Float, Float], tuple[Float, Float, Float]]
"""Depth and its slopes along and across, of (along, across) over the dent's size; 1 deep in the middle."""


@dataclass(frozen=True)
class Planted:
    """A dent of some profile: size_mm is along / stretch and across * stretch of it, turned by angle."""

    profile: Profile
    depth_mm: float
    x_mm: float
    y_mm: float
    size_mm: float
    stretch: float = 1.0
    angle: float = 0.0

    def _field(self, x: Float, y: Float) -> tuple[Float, Float, Float]:
        c, s = np.cos(self.angle), np.sin(self.angle)
        long, short = self.size_mm * self.stretch, self.size_mm / self.stretch
        x, y = x - self.x_mm, y - self.y_mm
        depth, along, across = self.profile((c * x + s * y) / long, (c * y - s * x) / short)
        along, across = along / long, across / short
        return depth, c * along - s * across, s * along + c * across

    def depth(self, x: Float, y: Float) -> Float:
        """Depth at a place, mm."""
        return np.asarray(self.depth_mm * self._field(x, y)[0])

    def slope(self, x: Float, y: Float) -> tuple[Float, Float]:
        """Its slopes along x and y."""
        _, by_x, by_y = self._field(x, y)
        return self.depth_mm * by_x, self.depth_mm * by_y


@dataclass(frozen=True)
class Sum:
    """Dents at once."""

    parts: tuple[Planted, ...]

    def depth(self, x: Float, y: Float) -> Float:
        """Depth at a place, mm."""
        return np.asarray(np.sum([part.depth(x, y) for part in self.parts], axis=0))

    def slope(self, x: Float, y: Float) -> tuple[Float, Float]:
        """Its slopes along x and y."""
        by_x, by_y = np.sum([part.slope(x, y) for part in self.parts], axis=0)
        return by_x, by_y


def gauss(along: Float, across: Float) -> tuple[Float, Float, Float]:
    """exp(-r^2 / 2)."""
    return gaussian(along, across, 1.0, 1.0)


def straight(along: Float, across: Float) -> tuple[Float, Float, Float]:
    """A blurred edge of twice its sigma."""
    return edge(along, across, 1.0, 1.0, 2.0)


def dry_ball(along: Float, across: Float) -> tuple[Float, Float, Float]:
    """Hertz."""
    return ball(along, across, 1.0, 1.0)


def sharp(along: Float, across: Float) -> tuple[Float, Float, Float]:
    """A cone (Sneddon), its tip blunted."""
    square = along**2 + across**2
    blunt = np.sqrt(1.0 + 0.04 / np.maximum(square, 1e-12))
    depth, by_along, by_across = cone(along * blunt, across * blunt, 1.0, 1.0)
    return depth, by_along / blunt, by_across / blunt


def power(exponent: float) -> Profile:
    """(1 + r^2)^(-exponent / 2)."""

    def of(along: Float, across: Float) -> tuple[Float, Float, Float]:
        square = 1.0 + along**2 + across**2
        depth = square ** (-exponent / 2)
        return depth, -exponent * along * depth / square, -exponent * across * depth / square

    return of


def pad(exponent: float) -> Profile:
    """exp(-r^exponent / 2): flatter than a Gaussian in the middle, and sharper at its end."""

    def of(along: Float, across: Float) -> tuple[Float, Float, Float]:
        square = along**2 + across**2 + 1e-12
        depth = np.exp(-0.5 * square ** (exponent / 2))
        rate = -0.5 * exponent * square ** (exponent / 2 - 1) * depth
        return depth, along * rate, across * rate

    return of


def layer(along: Float, across: Float) -> tuple[Float, Float, Float]:
    """exp(1 - sqrt(1 + r^2)): a layer on a stiff ground."""
    root = np.sqrt(1.0 + along**2 + across**2)
    depth = np.exp(1.0 - root)
    return depth, -along / root * depth, -across / root * depth


def bulged(along: Float, across: Float) -> tuple[Float, Float, Float]:
    """A Gaussian in a wide and shallow bulge, as rubber that keeps its volume makes one."""
    inner, outer = gaussian(along, across, 1.15, 1.0), gaussian(along, across, 0.15, 2.2)
    return inner[0] - outer[0], inner[1] - outer[1], inner[2] - outer[2]
