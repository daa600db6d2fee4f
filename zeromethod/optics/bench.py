"""Exact ray model of the bench: camera pixel to LCD, and LCD position back to the mirror's normal."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.optics.camera import CameraModel
from zeromethod.optics.fresnel import fresnel, s_share
from zeromethod.optics.joining import TOUCHES_MM, Joining
from zeromethod.optics.layers import direction_between, through_slabs
from zeromethod.optics.lever import lcd_per_slope
from zeromethod.optics.mirror import HeightField, distance_to, normal_of, rest_surface
from zeromethod.optics.panel import Panel
from zeromethod.optics.prism import Face, PrismGeometry
from zeromethod.optics.teeth import Saw
from zeromethod.optics.trace import Lost, Trace
from zeromethod.optics.vectors import dot, reflect, unit
from zeromethod.rig.model import Rig, check_rig

# in the order in which a ray meets them
_REASONS = [np.uint8(reason) for reason in range(Lost.MISSES_CAMERA_FACE, Lost.BELOW_TIR)]


class Optics:
    """Rays of one rig. Immutable; methods take arrays of any shape and pass NaN on.

    Rays are traced from the camera to the LCD, against the light. Only the mirror's reflectance is computed:
    the transmittance of faces and layers (about 0.97 each, nearly uniform over the view) is ignored.

    Parameters
    ----------
    rig : Rig
        The bench.

    Raises
    ------
    InputError
        Where the rest surface's height map cannot be used.

    Notes
    -----
    World in mm, origin on the edge P0, x along the mirror towards the camera face, z out of
    the rubber, y = z cross x; rubber at z < 0. Camera pixels (u, v) = (column, row) and LCD positions
    q = (column, row) have centres at integers. Directions are unit vectors along the travel.
    """

    def __init__(self, rig: Rig) -> None:
        check_rig("Optics", rig)
        self.rig = rig
        self.prism = PrismGeometry(rig.prism)
        self.saw = None if rig.prism.teeth is None else Saw(rig.prism)
        self.camera = CameraModel.place(rig.camera)
        self.rest: HeightField = rest_surface(rig)
        layers = rig.pattern_layers
        self.panel = Panel.place(rig.display, self.prism.pattern_face, sum(s.thickness_mm for s in layers))
        # the gap in front of a tilted panel varies: the last slab ends at the panel, not at its thickness
        self._inner_slabs = [(s.index, s.thickness_mm) for s in layers[:-1]]
        self._last_index = layers[-1].index if layers else rig.prism.index
        slabs = [(rig.prism.index, 0.0), *self._inner_slabs]
        faces = [self.prism.pattern_face] if self.saw is None else self.saw.pattern
        self.joinings = [Joining.of(self.panel, face, slabs, self._last_index) for face in faces]

    @property
    def length_mm(self) -> float:
        """Length L0 of the mirror along x."""
        return self.prism.length_mm

    def lcd_to_world(self, q: Float) -> Float:
        """World points (..., 3) in mm of LCD positions (..., 2) in px.

        Parameters
        ----------
        q : (..., 2) array
            LCD positions (column, row), px.

        Returns
        -------
        (..., 3) array
            World points, mm.
        """
        return self.panel.lcd_to_world(q)

    def camera_rays(self, u: Float, v: Float) -> tuple[Float, Float]:
        """Rays (origin, direction), each (..., 3), of camera pixels u, v (...), in air.

        Parameters
        ----------
        u, v : (...) array
            Camera pixels (column, row).

        Returns
        -------
        origin, direction : (..., 3) array
            Points, mm, and unit vectors along the travel.
        """
        return self.camera.rays(u, v)

    def rubber_rays(self, u: Float, v: Float) -> tuple[Float, Float]:
        """Rays (origin, direction), each (..., 3), of camera pixels inside the rubber.

        They start on the camera face, behind its layers, and do not depend on the mirror. NaN where the
        pixel misses the face or looks at it from behind.

        Parameters
        ----------
        u, v : (...) array
            Camera pixels (column, row).

        Returns
        -------
        origin, direction : (..., 3) array
            Points, mm, and unit vectors along the travel.
        """
        origin, direction = self.camera.rays(u, v)
        if self.saw is not None:
            return self.saw.enter(origin, direction, self.rig.prism.index)[:2]
        face = self.prism.camera_face
        slabs = [(s.index, s.thickness_mm) for s in reversed(self.rig.camera_layers)]
        outside = -face.depth_below(origin) - sum(t for _, t in slabs)
        with np.errstate(invalid="ignore", divide="ignore"):
            distance = outside / -dot(direction, face.normal)
            shift, inside = through_slabs(direction, -face.normal, 1.0, slabs, self.rig.prism.index)
            start = origin + distance[..., None] * direction + shift
        met = ((outside >= 0.0) & face.contains(start))[..., None]
        return np.where(met, start, np.nan), np.where(met, inside, np.nan)

    def trace(self, u: Float, v: Float, mirror: HeightField) -> Trace:
        """Rays of camera pixels u, v (...) by reflection at `mirror`.

        Parameters
        ----------
        u, v : (...) array
            Camera pixels (column, row).
        mirror : HeightField
            The mirror: `Optics.rest`, or any other height field.

        Returns
        -------
        Trace
            LCD positions, mirror points, incidence, reflectance, paths, and why rays are lost.
        """
        return self.trace_rays(*self.rubber_rays(u, v), mirror)

    def trace_rays(self, origin: Float, direction: Float, mirror: HeightField) -> Trace:
        """`trace` of rays in the rubber, (..., 3) each, from `rubber_rays`.

        Parameters
        ----------
        origin, direction : (..., 3) array
            Points, mm, and unit vectors along the travel.
        mirror : HeightField
            The mirror: `Optics.rest`, or any other height field.

        Returns
        -------
        Trace
            LCD positions, mirror points, incidence, reflectance, paths, and why rays are lost.
        """
        point, outgoing, cos_incidence, reflectance = self.reflected(origin, direction, mirror)
        q, path, on_mirror, on_face, free = self._by_prism(origin, point, outgoing)
        lost = np.select(
            [np.isnan(direction[..., 0]), ~on_mirror, ~on_face, np.isnan(path), ~self.panel.contains(q)],
            _REASONS,
            np.where(reflectance < 1.0, np.uint8(Lost.BELOW_TIR), np.uint8(Lost.NONE)),
        )
        lost = np.where(free | ((lost != Lost.NONE) & (lost != Lost.BELOW_TIR)), lost, np.uint8(Lost.SEAM))
        return Trace(q, point, cos_incidence, reflectance, path, lost)

    def reflected(
        self, origin: Float, direction: Float, mirror: HeightField
    ) -> tuple[Float, Float, Float, Float]:
        """Rays in the rubber after the mirror, which is taken to go on beyond its borders.

        Power reflectance, rubber to air, for the LCD's light: its field is projected across the ray in the
        rubber; the small rotation by unequal s and p transmittances of oblique faces is ignored.

        Parameters
        ----------
        origin, direction : (..., 3) array
            Points, mm, and unit vectors along the travel.
        mirror : HeightField
            The mirror: `Optics.rest`, or any other height field.

        Returns
        -------
        tuple of arrays
            Point (..., 3) mm, outgoing direction (..., 3), cos(incidence) and reflectance (...).
        """
        point, normal = self._met(origin, direction, mirror)
        cosine, outgoing = dot(direction, normal), reflect(direction, normal)
        s, p = fresnel(cosine, self.rig.prism.index, 1.0)
        share = 0.5 if self.panel.field is None else s_share(-outgoing, normal, self.panel.field)
        return point, outgoing, cosine, share * s + (1.0 - share) * p

    def centre(self) -> Trace:
        """Ray of the image's centre by the undeformed mirror.

        Returns
        -------
        Trace
            Of one ray, (1,).
        """
        u, v = (np.array([(count - 1) / 2]) for count in (self.rig.camera.columns, self.rig.camera.rows))
        return self.trace(u, v, self.rest)

    def rest_map(self, u: Float, v: Float) -> Float:
        """LCD positions (..., 2) in px that camera pixels u, v (...) look at by the undeformed mirror.

        NaN where the ray is lost before the LCD's plane.

        Parameters
        ----------
        u, v : (...) array
            Camera pixels (column, row).

        Returns
        -------
        (..., 2) array
            LCD positions, px.
        """
        origin, direction = self.rubber_rays(u, v)
        point, normal = self._met(origin, direction, self.rest)
        return self._by_prism(origin, point, reflect(direction, normal))[0]

    def rubber_direction_to_lcd(self, point: Float, q: Float) -> Float:
        """Direction (..., 3), in the rubber, of the ray from a mirror point to an LCD position.

        point (..., 3) in mm, q (..., 2) in px. The refraction through all layers is solved exactly; faces
        count as unbounded. NaN where no ray joins the two.

        Parameters
        ----------
        point : (..., 3) array
            Points on the mirror, mm.
        q : (..., 2) array
            LCD positions (column, row), px.

        Returns
        -------
        (..., 3) array
            Unit vectors along the travel.
        """
        face = self.prism.pattern_face
        offset = self.panel.lcd_to_world(q) - point
        rubber = face.depth_below(point)
        last = dot(offset, face.normal) - rubber - sum(t for _, t in self._inner_slabs)
        last = np.where(np.abs(last) < TOUCHES_MM, 0.0, last)
        slabs = [(self.rig.prism.index, rubber)]
        slabs += [(n, np.full_like(rubber, t)) for n, t in self._inner_slabs]
        slabs += [(self._last_index, last)]
        indices, thicknesses = zip(*slabs, strict=True)
        return direction_between(offset, face.normal, indices, np.stack(np.broadcast_arrays(*thicknesses)))

    def normal_between(self, incoming: Float, outgoing: Float) -> Float:
        """Unit normal (..., 3), out of the rubber, that reflects one unit vector into another.

        The surface's (dz/dx, dz/dy) is -(nx, ny) / nz, so the depth's slope is the rest surface's gradient
        plus (nx, ny) / nz.

        Parameters
        ----------
        incoming, outgoing : (..., 3) array
            Unit vectors along the travel.

        Returns
        -------
        (..., 3) array
            Unit normals.
        """
        with np.errstate(invalid="ignore"):
            return unit(incoming - outgoing)

    def sensitivity(self, u: Float, v: Float) -> Float:
        """LCD shift per depth slope at rest: (..., 2, 2) in LCD px per rad.

        Rows: LCD (column, row); columns: slope (dd/dx, dd/dy), at a fixed mirror point. Closed form; faces
        count as unbounded. NaN where the ray never reaches the mirror or the LCD's plane.

        Parameters
        ----------
        u, v : (...) array
            Camera pixels (column, row).

        Returns
        -------
        (..., 2, 2) array
            LCD px per rad.
        """
        return sensitivity_of_rays(self, *self.rubber_rays(u, v))

    def _met(self, origin: Float, direction: Float, mirror: HeightField) -> tuple[Float, Float]:
        """Where rays in the rubber meet a mirror that goes on beyond its borders: point mm, unit normal."""
        point = origin + distance_to(mirror, origin, direction)[..., None] * direction
        with np.errstate(invalid="ignore"):
            return point, normal_of(mirror.gradient(point[..., 0], point[..., 1]))

    def _left_by(self, point: Float, outgoing: Float) -> tuple[Face, Mask]:
        """The face by which rays from the mirror leave, and whether they meet it (of a saw, or all but)."""
        if self.saw is None:
            return self.prism.pattern_face, np.ones(point.shape[:-1], bool)
        return self.saw.exit_face(point, outgoing)

    def _by_prism(
        self, origin: Float, point: Float, outgoing: Float
    ) -> tuple[Float, Float, Mask, Mask, Mask]:
        """LCD position (..., 2) and path in mm (...), NaN off the mirror or the face; which are on each.

        And whether no tooth of a saw is in the way.
        """
        on_mirror = self.prism.on_mirror(point[..., 0], point[..., 1])
        face, near = self._left_by(point, outgoing)
        q, path, exit_point = self._to_display(face, point, outgoing)
        on_face, free = face.contains(exit_point), np.ones(path.shape, bool)
        if self.saw is not None:
            free = on_face & self.saw.clear(origin, point, exit_point, self.panel.lcd_to_world(q))
            on_face = near & np.isfinite(exit_point[..., 0])
        q[~(on_mirror & on_face)] = np.nan
        path[~(on_mirror & on_face)] = np.nan
        return q, path, on_mirror, on_face, free

    def _to_display(self, face: Face, point: Float, outgoing: Float) -> tuple[Float, Float, Float]:
        """LCD position (..., 2), path in mm (...) and exit point (..., 3) on a face's plane.

        q and path are NaN where the panel's plane is not met; the faces' borders are ignored.
        """
        index = self.rig.prism.index
        with np.errstate(invalid="ignore", divide="ignore"):
            in_rubber = face.depth_below(point) / dot(outgoing, face.normal)
            in_rubber = np.where(in_rubber >= 0.0, in_rubber, np.nan)
            leaves = point + in_rubber[..., None] * outgoing
            shift, last = through_slabs(outgoing, face.normal, index, self._inner_slabs, self._last_index)
            start = leaves + shift
            gap = dot(self.panel.centre - start, self.panel.normal) / dot(last, self.panel.normal)
            in_slabs = np.sqrt(dot(shift, shift))
        q = self.panel.world_to_lcd(start + gap[..., None] * last)
        path = in_rubber + in_slabs + gap
        q[gap < -TOUCHES_MM] = np.nan
        return q, path, leaves


def sensitivity_of_rays(optics: Optics, origin: Float, direction: Float) -> Float:
    """`Optics.sensitivity` (..., 2, 2) of rays in the rubber, (..., 3) each, from `Optics.rubber_rays`."""
    point = origin + distance_to(optics.rest, origin, direction)[..., None] * direction
    with np.errstate(invalid="ignore", divide="ignore"):
        gradient = optics.rest.gradient(point[..., 0], point[..., 1])
        slabs = [(optics.rig.prism.index, 0.0), *optics._inner_slabs]
        face = optics._left_by(point, reflect(direction, normal_of(gradient)))[0]
        return lcd_per_slope(point, direction, gradient, face, optics.panel, slabs, optics._last_index)
