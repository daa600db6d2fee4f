"""OpenGL without a screen: contexts and shader programs."""

from zeromethod.gl.context import backend_of, collect, create_context, renderer_name
from zeromethod.gl.shader import program, shader_source

__all__ = ["backend_of", "collect", "create_context", "program", "renderer_name", "shader_source"]
