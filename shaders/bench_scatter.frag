#version 330 core
// Light that objects in contact scatter towards the camera, of an even panel's.
uniform sampler2D scattered;
uniform float scale;        // mean light of the panel

layout(location = 0) out float light;

#include "bench_texel.glsl"

void main() {
    light = scale * texel(scattered, ivec2(gl_FragCoord.xy), pitch_of(scattered)).r;
}
