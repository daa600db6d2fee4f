#version 330 core
// Smallest box (low column, low row, high column, high row) of the LCD under a BLOCK x BLOCK tile of camera
// pixels, what the pixels respond to included; low > high where no ray arrives.
#include "bench_texel.glsl"
uniform sampler2D rays, footprints;
uniform float reach;        // camera px

layout(location = 0) out vec4 bounds;

void main() {
    ivec2 first = ivec2(gl_FragCoord.xy) * BLOCK;
    ivec2 end = min(first + BLOCK, textureSize(rays, 0));
    vec2 pitch = pitch_of(rays);
    bounds = vec4(1e9, 1e9, -1e9, -1e9);
    for (int j = first.y; j < end.y; ++j) {
        for (int i = first.x; i < end.x; ++i) {
            vec4 ray = texel(rays, ivec2(i, j), pitch);
            vec4 foot = texel(footprints, ivec2(i, j), pitch);
            vec2 half_size = reach * (abs(foot.xy) + abs(foot.zw));
            if (ray.z > 0.0) {
                bounds.xy = min(bounds.xy, ray.xy - half_size);
                bounds.zw = max(bounds.zw, ray.xy + half_size);
            }
        }
    }
}
