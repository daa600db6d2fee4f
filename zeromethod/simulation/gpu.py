"""The bench drawn by fragment shaders: mirror, refraction, LCD apertures imaged by the lens."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count

import moderngl
import numpy as np

from zeromethod.arrays import Bytes, Single
from zeromethod.gl import create_context, unfiltered
from zeromethod.rig.model import Rig
from zeromethod.simulation.gpu_light import CameraLight, PanelLight
from zeromethod.simulation.gpu_rays import LcdRegion, RayTracer
from zeromethod.simulation.press import Mirror
from zeromethod.simulation.renderer import Handle, Piece, by_mirror, check_picture, mirror_shares


class GpuRenderer:
    """`BenchRenderer` on OpenGL 3.3, with a ray model of its own (float32, <= 0.02 LCD px).

    Pictures stay on the GPU: `new_picture` hands out a framebuffer that a pattern is drawn into. Unchanged
    mirrors are not traced again, unchanged pictures not summed again.

    Convention: a picture's framebuffer is as a window's, LCD row 0 is its top line (the last texel row); in
    all other textures row 0 comes first, camera pixel (u, v) is texel (u, v). A given `context` stays the
    caller's and is made current in every call.
    """

    def __init__(self, rig: Rig, context: moderngl.Context | None = None) -> None:
        """Compile and allocate. Raises InputError without a GL context or with an unusable rest map."""
        self._owned = context is None
        self.context = create_context() if context is None else context
        self._display = rig.display
        self._names = count(1)
        self._pictures: dict[Handle, moderngl.Framebuffer] = {}
        self._spare: list[moderngl.Framebuffer] = []
        self._closed = False
        with self.context:
            self._tracer = RayTracer(self.context, rig)
            self._panel = PanelLight(self.context, rig)
            lamp_px2 = self._tracer.seen_px2() if rig.light.by_mirror else 0.0
            self._camera = CameraLight(self.context, rig, lamp_px2)

    def move(self, rig: Rig) -> None:
        """Have camera and LCD where `rig` has them; compiles the rays' shaders again."""
        with self.context:
            self._tracer.release()
            self._tracer = RayTracer(self.context, rig)

    def new_picture(self) -> tuple[Handle, moderngl.Framebuffer]:
        """Empty picture: LCD size, one 8-bit channel of grey codes; content undefined until drawn.

        Draw before the first `expose` that names it, and not after: what was summed is not summed again.
        """
        with self.context:
            if self._spare:
                framebuffer = self._spare.pop()
            else:
                size = self._display.columns, self._display.rows
                texture = unfiltered(self.context.texture(size, 1, dtype="f1"))
                framebuffer = self.context.framebuffer(color_attachments=[texture])
        handle = next(self._names)
        self._pictures[handle] = framebuffer
        return handle, framebuffer

    def upload(self, image: Bytes) -> Handle:
        """Take over LCD grey codes (rows, cols). Raises InputError on another shape or type."""
        check_picture(image, self._display)
        handle, framebuffer = self.new_picture()
        with self.context:
            self._texture(framebuffer).write(np.ascontiguousarray(image[::-1]))
        return handle

    def release(self, handle: Handle) -> None:
        """Forget a picture; its texture is used again."""
        self._spare.append(self._pictures.pop(handle))

    def expose(self, pieces: Sequence[Piece], projected: Single | None = None) -> Single:
        """(camera rows, cols) float32 light, see `BenchRenderer`; the next call uses the array again."""
        with self.context:
            self._camera.start()
            mirrors = mirror_shares(pieces)
            for mirror, shares in by_mirror(pieces).items():
                maps = self._tracer.maps(mirror)
                region = maps[0].region
                for ghost in maps[1:]:
                    region = region.joined(ghost.region)
                scattered = maps[0].scattered
                if scattered is not None:
                    region = LcdRegion(0, 0, self._display.columns, self._display.rows)
                lit = [(self._texture(self._pictures[handle]), share) for handle, share in shares.items()]
                panel = self._panel.draw(list(shares), lit, region)
                for ray_map in maps:
                    self._camera.add(ray_map, panel)
                if scattered is not None:
                    self._camera.add_scattered(scattered, self._panel.mean())
                if projected is not None and maps[0].sent_back is not None:
                    self._camera.add_projected(maps[0], projected, mirrors[mirror])
            return self._camera.read()

    def ray_map(self, mirror: Mirror) -> tuple[Single, Single]:
        """(q (rows, cols, 2) LCD px, NaN where lost; reflectance (rows, cols), 0 there), new arrays."""
        with self.context:
            rays = self._tracer.maps(mirror)[0].rays.read()
        q = rays[..., :2].copy()
        q[rays[..., 3] == 0.0] = np.nan
        return q, rays[..., 2].copy()

    def close(self) -> None:
        """Free everything; safe to call twice."""
        if self._closed:
            return
        self._closed = True
        with self.context:
            for framebuffer in (*self._pictures.values(), *self._spare):
                self._texture(framebuffer).release()
                framebuffer.release()
            for each in (self._tracer, self._panel, self._camera):
                each.release()
        self._pictures.clear()
        self._spare.clear()
        if self._owned:
            self.context.release()

    @staticmethod
    def _texture(framebuffer: moderngl.Framebuffer) -> moderngl.Texture:
        attachment = framebuffer.color_attachments[0]
        assert isinstance(attachment, moderngl.Texture)
        return attachment
