"""Drawing the LCD's picture: the target, pulled over a mesh whose vertices lie at the warp."""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Bytes, Float, Mask
from zeromethod.gl import float_texture, program, set_uniforms
from zeromethod.pattern.coded import MOST_PARTS, Coded
from zeromethod.pattern.light_carry import FORGET_ABOVE, MOST_OWED, LightCarry
from zeromethod.pattern.response import TABLE_SIZE, Response
from zeromethod.pattern.strips import BITS, Strips, bits_of
from zeromethod.pattern.target import Target
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.interpolant import window_matched
from zeromethod.warp.jacobian import FEWEST_LCD_PX, jacobian

CLEAR_LCD_PX = 6.0
"""LCD px per carrier period from which the carrier is drawn at full contrast."""

NEWTON_STEPS = 2
"""Steps from the linear mesh to the interpolant: at 40 LCD px over sigma 32 px, one leaves 0.05 camera px."""

_KINDS = ("cosines", "checker", "lattice", "noise")
_NODES, _PLACES, _CODES, _NOISE, _EXPONENTS, _LAMP, _KEPT, _LIGHT = range(8)  # texture units


def _triangles(columns: int, rows: int, turned: bool) -> NDArray[np.int32]:
    """Vertex numbers of a mesh of columns x rows vertices, front faces anticlockwise on the screen."""
    corner = np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)
    right, below, across = corner + 1, corner + columns, corner + columns + 1
    order = (
        [corner, right, below, right, across, below]
        if turned
        else [corner, below, right, right, below, across]
    )
    return np.stack(order, axis=-1).astype(np.int32).ravel()


def _fringes(coded: Coded | None) -> dict[str, Any]:
    """Uniforms of a coded picture; of none."""
    if coded is None:
        return {"coded_parts": 0}
    parts = np.zeros((MOST_PARTS, 4))
    parts[: len(coded.parts)] = coded.parts
    fringes = coded.axis, coded.period_px, coded.shift_rad
    return {"coded_parts": len(coded.parts), "parts": parts, "fringes": fringes}


class PatternRenderer:
    """Draws, for every LCD pixel, the grey code of the target's light where the warp meets that pixel.

    Two passes. A mesh over the node lattice writes, to first order, which camera position an LCD pixel
    belongs to; then every LCD pixel solves q(u, v) = pixel by Newton steps on the Keys interpolant, the
    one that `compose` uses. (Newton in the mesh's own fragments costs twice as much on a CPU, where small
    triangles leave most lanes idle; subdividing by 4 costs more still and is less exact.) What is
    turned inside out against `q_rest` is not drawn. Carriers fade out between 6 and 4 LCD px per period.
    Outside the mesh, and where the 4 x 4 nodes around hold a NaN: the mean light.

    grid, q_rest: node lattice and warp at rest, (rows, cols, 2) LCD px. size: (columns, rows) of the LCD.
    strips: where coded strips go; they are drawn in pictures that are given a code, over the target.
    carry: each LCD pixel shows in its next picture the light that rounding left out (`pattern.light_carry`).
    All objects live in `ctx`, which must be current in every call.

    Convention: LCD row 0 is the picture's top line, so GL's *last* framebuffer row.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        grid: NodeGrid,
        q_rest: Float,
        size: tuple[int, int],
        target: Target,
        response: Response,
        strips: Strips | None = None,
        carry: bool = False,
    ) -> None:
        self._ctx = ctx
        self._size = size
        mean = response.code(target.mean)
        self._mean = mean / 255, target.mean
        rows, cols = grid.shape
        facing = float(np.sign(np.nanmedian(np.linalg.det(jacobian(q_rest, grid.spacing_px)))))
        mesh = program(ctx, "pattern_mesh.vert", "pattern_mesh.frag")
        set_uniforms(mesh, {"nodes": _NODES, "mesh_columns": cols - 2, "display_px": size})
        indices = ctx.buffer(_triangles(cols - 2, rows - 2, turned=facing < 0).tobytes())
        self._mesh = ctx.vertex_array(mesh, [], index_buffer=indices)
        constants: dict[str, Any] = {
            "STEPS": NEWTON_STEPS,
            "KIND": _KINDS.index(target.kind),
            "PERIOD": float(target.period_px),
            "SPACING": float(grid.spacing_px),
            "MEAN": target.mean,
            "CONTRAST": target.contrast,
            "FADED_PX": FEWEST_LCD_PX,
            "CLEAR_PX": CLEAR_LCD_PX,
            "CODES": TABLE_SIZE,
            "REGIONS": int(response.exponent is not None),
            "MOST_PARTS": MOST_PARTS,
            "CARRY": int(carry),
            "FORGET_ABOVE": FORGET_ABOVE,
            "MOST_OWED": MOST_OWED,
        }
        self._plain = program(ctx, "pattern.vert", "pattern.frag", STRIPS=0, **constants)
        self._coded = self._plain
        if strips is not None:
            constants |= {"BITS": BITS, "ALONG_U": strips.along_u}
            self._coded = program(ctx, "pattern.vert", "pattern.frag", STRIPS=1, **constants)
            one, two = strips.first, strips.last
            places = (one.start_px, one.unit_px, two.start_px, two.unit_px)
            set_uniforms(self._coded, {"strip_edges": (one.edge_px, two.edge_px), "strip_places": places})
        units = {"nodes": _NODES, "places": _PLACES, "codes": _CODES}
        units |= {"texture_of_noise": _NOISE, "exponents": _EXPONENTS, "lamp": _LAMP}
        units |= {"kept_before": _KEPT, "light_of_codes": _LIGHT}
        first_px = grid.u_px[0], grid.v_px[0]
        for box in (self._plain, self._coded):
            set_uniforms(box, units | {"display_px": size, "first_px": first_px, "facing": facing})
        self._rectangles = {box: ctx.vertex_array(box, []) for box in {self._plain, self._coded}}
        self._pairs = np.zeros((rows, cols, 4), dtype=np.float32)
        noise = target.texture if target.kind == "noise" else np.zeros((1, 1), dtype=np.float32)
        self._textures = {
            _NODES: float_texture(ctx, self._pairs),
            _PLACES: ctx.texture(size, 2, dtype="f4"),
            _CODES: float_texture(ctx, response.table[None]),
            _NOISE: float_texture(ctx, noise),
            _LAMP: float_texture(ctx, np.zeros((rows, cols), dtype=np.float32)),
        }
        if response.exponent is not None:
            self._textures[_EXPONENTS] = float_texture(ctx, np.array(response.exponent))
        self._places = ctx.framebuffer([self._textures[_PLACES]])
        self._carry = LightCarry(ctx, size, response, (_KEPT, _LIGHT)) if carry else None
        self._own: moderngl.Framebuffer | None = None
        self._lamp: Mask | None = None

    def render(
        self,
        framebuffer: moderngl.Framebuffer,
        q: Float,
        code: int | None = None,
        coded: Coded | None = None,
        lamp: Mask | None = None,
        shift: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Draw the picture of warp q, (rows, cols, 2) LCD px, into a framebuffer of the LCD's size.

        code: 0..15, drawn into the strips; without it, or without strips, there is only the target.
        coded: fringes drawn over parts of the LCD.
        lamp: (rows, cols) nodes around which it is the target's brightest light, not to be changed any more.
        shift: the target at camera position (u, v) is that at (u, v) + shift, periods along u and v.
        Nothing is read back. Red, green and blue all hold code / 255. Leaves `framebuffer` bound and
        blending, depth test and culling off.
        """
        window_matched(q, self._pairs)
        self._pairs[:, :-1, 2:] = self._pairs[:, 1:, :2]
        self._textures[_NODES].write(self._pairs)
        if lamp is not None and lamp is not self._lamp:
            self._textures[_LAMP].write(lamp.astype(np.float32))
            self._lamp = lamp
        for unit, texture in self._textures.items():
            texture.use(unit)
        self._places.use()
        self._places.clear()
        self._ctx.enable_only(moderngl.CULL_FACE)
        self._mesh.render(moderngl.TRIANGLES)
        self._ctx.enable_only(moderngl.NOTHING)
        shown, light = self._mean
        if self._carry is None:
            framebuffer.use()
            framebuffer.viewport = (0, 0, *self._size)
            framebuffer.clear(shown, shown, shown, 1.0)
        else:
            self._carry.begin(255 * shown, light)
        bounds = self._clip_bounds()
        if bounds is not None:
            box = self._plain if code is None else self._coded
            bits = sum(bit << k for k, bit in enumerate(bits_of(code or 0)))
            set_uniforms(box, {"bounds": bounds, "strip_bits": bits, "lit": int(lamp is not None)})
            set_uniforms(box, {"moved": (shift[0] % 1.0, shift[1] % 1.0)})
            set_uniforms(box, _fringes(coded))
            self._rectangles[box].render(moderngl.TRIANGLE_STRIP, vertices=4)
        if self._carry is not None:
            framebuffer.use()
            framebuffer.viewport = (0, 0, *self._size)
            self._carry.show()

    def _clip_bounds(self) -> tuple[float, float, float, float] | None:
        """Left, bottom, right, top of all nodes in clip space; None when no node has a warp."""
        nodes = self._pairs[:, :, :2].reshape(-1, 2)
        low, high = np.fmin.reduce(nodes), np.fmax.reduce(nodes)
        if not np.isfinite(low + high).all():
            return None
        left, top = 2 * (low + 0.5) / self._size - 1
        right, bottom = 2 * (high + 0.5) / self._size - 1
        return float(left), float(-bottom), float(right), float(-top)

    def image(
        self,
        q: Float,
        code: int | None = None,
        coded: Coded | None = None,
        lamp: Mask | None = None,
        shift: tuple[float, float] = (0.0, 0.0),
    ) -> Bytes:
        """Picture of warp q, as `render` draws it, as (rows, cols) uint8 grey codes, row 0 at the top."""
        columns, rows = self._size
        if self._own is None:
            self._own = self._ctx.framebuffer([self._ctx.texture(self._size, 1)])
        self.render(self._own, q, code, coded, lamp, shift)
        upside_down = np.frombuffer(self._own.read(components=1, alignment=1), dtype=np.uint8)
        return np.ascontiguousarray(upside_down.reshape(rows, columns)[::-1])
