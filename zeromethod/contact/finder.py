"""Contacts of frame after frame: found, outlined, followed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import cv2
import numpy as np

from zeromethod.arrays import Float, Image, Single
from zeromethod.contact.contact import LEAST_MM2, Contact, Probability
from zeromethod.contact.deepest import deepest_of_all
from zeromethod.contact.force_fit import ForceFit
from zeromethod.contact.in_mm import MirrorPlaces
from zeromethod.contact.inside import carried_inside
from zeromethod.contact.moments import moments
from zeromethod.contact.outline import (
    WINDOW_PX,
    Outline,
    first_outline,
    refined,
)
from zeromethod.contact.picture import Places, image_of, places_of
from zeromethod.contact.polygon import normals, perimeter, signed_area
from zeromethod.contact.region import Region, RegionFinder
from zeromethod.contact.rest import RestPicture
from zeromethod.contact.shadow import Shadows
from zeromethod.contact.textured import TexturedFinder
from zeromethod.contact.track import ContactTrack
from zeromethod.optics import Optics
from zeromethod.optics.pupil import footprint_terms
from zeromethod.rig.model import Rig
from zeromethod.sensing.residual import Residual
from zeromethod.surface import Peak, Surface
from zeromethod.warp.grid import NodeGrid

_LENS_PX = 0.5
"""Blur of a border by a pupil that the rig does not give."""
_PIXEL_PX2 = 1 / 6
"""Variance of a border's blur by the pixel's square, and as much again by what the lens leaves unsharp."""
_EDGE_PX = 0.1
"""What the blur's own uncertainty leaves open of a border."""
_PARTED_PX = 4.0
"""Standard deviation of the border drawn round parts with gaps between."""


class ContactFinder:
    """Finds contacts in the frames of a run, in turn.

    Until the picture at rest is known (`RestPicture`), there are none. Serves one thread.
    """

    def __init__(self, rig: Rig, optics: Optics, grid: NodeGrid) -> None:
        self._rest = RestPicture(rig, grid)
        kind = TexturedFinder if rig.control.rubbing else RegionFinder
        self._regions = kind(rig, grid, border_blur_px(rig))
        self._shadows = Shadows(optics, border_blur_px(rig), self._regions.noise)
        self._places = MirrorPlaces(optics, grid)
        self._track = ContactTrack()
        self.unnamed: tuple[Contact, ...] = ()
        """Of the last frame: contacts that press, but were not seen in a second one yet."""
        self._lit = np.zeros(grid.shape, bool)
        self._grid, self._black = grid, rig.camera.noise.black_grey

    @property
    def ready(self) -> bool:
        """Whether the picture at rest is known."""
        return self._rest.known

    @property
    def followed(self) -> frozenset[int]:
        """Ids of the contacts that are not lifted, seen in the last frame or not."""
        return self._track.ids

    def follow(
        self, image: Image, residual: Residual, surface: Surface, *, nulled: bool, exposure_ns: int = 0
    ) -> tuple[Contact, ...]:
        """Contacts of the next frame, largest first.

        Parameters
        ----------
        image : (image rows, image cols) uint8 or uint16
            The frame.
        residual, surface : Residual, Surface
            What was measured and read from it.
        nulled : bool
            Whether the camera sees the target in it, so that it may teach the picture at rest.
        exposure_ns : int, optional
            How long it was exposed, as light grows with it; 0 where it does not change.

        Returns
        -------
        tuple of Contact
            Those seen in two frames in a row, and in one of the last two.
        """
        if exposure_ns:
            self._rest.expose(exposure_ns)
        if not self._rest.known:
            if nulled:
                self._rest.add(image, residual)
            return ()
        found = [each for each in self._found(image, residual, surface) if each is not None]
        return self._named(found, surface)

    def _found(self, image: Image, residual: Residual, surface: Surface) -> Iterable[Contact | None]:
        """What is seen in this frame by itself, largest first."""
        regions = self._regions.find(image, residual, self._rest)
        return (self._contact(region, surface) for region in regions)

    def _named(self, found: list[Contact], surface: Surface) -> tuple[Contact, ...]:
        return self._track.follow(found, surface.time_ns)

    def carry(
        self, surface: Surface, deepest: Peak, contacts: tuple[Contact, ...], fit: ForceFit | None
    ) -> tuple[Surface, Peak, tuple[Contact, ...]]:
        """Surface, peak and contacts with the depth inside contacts, as far as it can be known.

        Parameters
        ----------
        surface, deepest : Surface, Peak
            As measured around the contacts.
        contacts : tuple of Contact
            What `follow` found.
        fit : ForceFit or None
            What presses there, by the slopes around (`ForceReader.fit`).

        Returns
        -------
        Surface, Peak, tuple of Contact
            The surface with `inside`, the deepest point of all of it, contacts with `depth_mm`.
        """
        self._lit |= surface.valid
        if contacts:
            inside, contacts = carried_inside(surface, contacts, self._places, fit)
            surface = replace(surface, inside=inside)
        return surface, deepest_of_all(surface, deepest, contacts, self._lit), contacts

    def with_images(
        self, image: Image, residual: Residual, surface: Surface, contacts: tuple[Contact, ...]
    ) -> tuple[Contact, ...]:
        """The contacts with their images.

        Parameters
        ----------
        image, residual : array, Residual
            The frame, and what was measured in it.
        surface : Surface
            As `carry` gave it.
        contacts : tuple of Contact
            What `follow` found.

        Returns
        -------
        tuple of Contact
            The same, each with an `image` where its place in mm is known.
        """
        if not contacts:
            return contacts
        mean, drift = self._rest.mean, self._rest.drift(residual)
        with_image = []
        for contact in contacts:
            places = places_of(contact, surface, self._grid)
            if places is not None:
                seen = image_of(contact, image, mean, drift, self._black, places)
                sunk = self._sunk(contact, places)
                seen = replace(seen, sunk_x_mm=float(sunk[0]), sunk_y_mm=float(sunk[1]))
                contact = replace(contact, image=seen)  # noqa: PLW2901 - the same with its image
            with_image.append(contact)
        return tuple(with_image)

    def _sunk(self, contact: Contact, places: Places) -> Float:
        """(2,) mm that the middle of a contact lies, by the mirror's depth, from where it is seen at rest."""
        reach = 0.25 * np.ptp(contact.outline_mm, axis=0)
        x, y = (m + np.linspace(-r, r, 5) for m, r in zip((contact.x_mm, contact.y_mm), reach, strict=True))
        at = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        return np.asarray((at - self._places.at_rest(places.pixels(x, y).reshape(-1, 2))).mean(axis=0))

    def _contact(self, region: Region, surface: Surface) -> Contact | None:
        edge = _outline(region)
        corner = np.array([region.left, region.top])
        points_px = edge.points_px + corner
        seen = self._places.seen(points_px, surface)
        slant = self._places.per_depth(points_px)
        trimmed = self._shadows.without(edge.points_px, region, seen.outline_mm, slant, seen.at_1_mm)
        if trimmed is not None:
            points_px = trimmed.points_px + corner
            seen = self._places.seen(points_px, surface)
            region = replace(region, probability=_within(region.probability, trimmed.points_px))
        seen_mm = seen.outline_mm
        if signed_area(seen_mm) < 0:  # the camera sees the mirror mirrored
            seen_mm, points_px = seen_mm[::-1], points_px[::-1]
        area = signed_area(seen_mm)
        if area < LEAST_MM2:
            return None
        # a sharp edge loses no light beyond itself, a ball's does: half of that, and half left open
        beyond = seen.beyond_mm / 2
        outline_mm = seen_mm - beyond * normals(seen_mm)
        pixel_mm = float(np.sqrt(area / abs(signed_area(points_px))))
        shadow_px = 0.0 if trimmed is None else trimmed.sigma_px
        open_mm = float(np.hypot(beyond, np.hypot(_EDGE_PX, shadow_px) * pixel_mm))
        own_mm = edge.sigma_px * pixel_mm
        around_mm = perimeter(outline_mm)
        apart_mm = own_mm / np.sqrt(max(around_mm / pixel_mm / WINDOW_PX, 1.0))
        # how far in or out all of it lies stays as it is from frame to frame: it is in the area alone
        borders_mm = open_mm, apart_mm, region.border_px * pixel_mm
        gaps_mm2 = 0.0
        if region.parted:  # the parts are somewhere between what is surely theirs and all within the border
            gaps_mm2 = 0.5 * max(area - pixel_mm**2 * float(region.probability[region.mask].sum()), 0.0)
        sigma_x, sigma_y = (float(np.hypot(part, max(apart_mm, 0.2 * open_mm))) for part in seen.sigma_mm)
        return Contact(
            id=0,
            **moments(outline_mm)._asdict(),
            sigma_x_mm=sigma_x,
            sigma_y_mm=sigma_y,
            sigma_area_mm2=float(np.linalg.norm([*(around_mm * one for one in borders_mm), gaps_mm2])),
            outline_mm=outline_mm,
            sigma_edge_mm=float(np.sqrt(open_mm**2 + own_mm**2 + sum(np.square(seen.sigma_mm)) / 2)),
            outline_px=points_px,
            scattered=region.scattered,
            leak_mm=beyond,
            probability=Probability(region.left, region.top, region.probability),
        )


def _within(probability: Single, points_px: Float) -> Single:
    """The probability, 0 beyond a border."""
    mask = np.zeros(probability.shape, np.uint8)
    cv2.fillPoly(mask, [np.rint(points_px * 16).astype(np.int32)], 1, shift=4)
    return np.where(mask > 0, probability, np.float32(0))


def _outline(region: Region) -> Outline:
    """The border in the region's own pixels; round parts with gaps it is as good as the gaps are narrow."""
    first = first_outline(region.mask)
    return Outline(first, _PARTED_PX) if region.parted else refined(first, region.columns, region.model)


def border_blur_px(rig: Rig) -> float:
    """Standard deviation of a border's blur by pixel and pupil; where no pupil is given, by some lens."""
    pupil = _LENS_PX
    if rig.camera.pupil_mm > 0:
        # of a disc, its radius in the middle of the view
        pupil = float(np.sqrt(np.abs(np.linalg.det(footprint_terms(rig)[0])))) / 2
    return float(np.hypot(pupil, np.sqrt(_PIXEL_PX2)))
