"""OpenGL without a screen: contexts, shader programs and what goes into them."""

from zeromethod.gl.context import collect, create_context
from zeromethod.gl.shader import program
from zeromethod.gl.values import float_texture, set_uniforms, unfiltered

__all__ = ["collect", "create_context", "float_texture", "program", "set_uniforms", "unfiltered"]
