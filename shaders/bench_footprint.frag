#version 330 core
// Footprint of each camera pixel on the LCD: (dq/du, dq/dv) in LCD px, by differences of the ray map.
// PUPIL: the pupil spreads it further; the sides of a parallelogram of the same second moments take its place.
#include "bench_texel.glsl"
uniform sampler2D rays;
#if PUPIL
uniform sampler2D spread;
#endif

layout(location = 0) out vec4 footprint;

vec2 difference(ivec2 pixel, vec4 here, ivec2 step_by, ivec2 last, vec2 pitch) {
    vec4 after = texel(rays, pixel + step_by, pitch);
    vec4 before = texel(rays, pixel - step_by, pitch);
    // a lost neighbour (w = 0) leaves the one-sided difference
    vec2 ahead = after.w * (after.xy - here.xy), behind = before.w * (here.xy - before.xy);
    float sides = after.w * float(all(lessThanEqual(pixel + step_by, last)))
        + before.w * float(all(greaterThanEqual(pixel - step_by, ivec2(0))));
    return (ahead + behind) / max(sides, 1.0);
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    ivec2 last = textureSize(rays, 0) - 1;
    vec2 pitch = pitch_of(rays);
    vec4 here = texel(rays, pixel, pitch);
    footprint = vec4(
        difference(pixel, here, ivec2(1, 0), last, pitch), difference(pixel, here, ivec2(0, 1), last, pitch));
#if PUPIL
    vec3 wider = texel(spread, pixel, pitch).xyz;
    if (dot(wider, wider) > 0.0) {
        vec3 moments = vec3(
            dot(footprint.xz, footprint.xz), dot(footprint.xz, footprint.yw), dot(footprint.yw, footprint.yw));
        moments += wider;
        float wide = sqrt(max(moments.x, 1e-12)), slant = moments.y / wide;
        footprint = vec4(wide, slant, 0.0, sqrt(max(moments.z - slant * slant, 0.0)));
    }
#endif
}
