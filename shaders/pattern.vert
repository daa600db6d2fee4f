#version 330 core
// Second pass: one rectangle around all of the warp.
uniform vec4 bounds;  // left, bottom, right, top in clip space

void main() {
    gl_Position = vec4(gl_VertexID % 2 == 0 ? bounds.x : bounds.z, gl_VertexID / 2 == 0 ? bounds.y : bounds.w, 0.0, 1.0);
}
