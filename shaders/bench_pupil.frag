#version 330 core
// Means over the pupil's footprint of what single rays see, read off their map at shifted places.
// PART 0: (q, reflectance, 1 where light comes). 1: second moments (xx, xy, yy) of q about its mean, in units of
// the pixel's own response. 2: light of one channel, its mean. SAMPLES points of the unit disc, ON_RING on each of
// its rings; shift_0 to shift_5: terms of (shift along u by the pupil's u, by its v; along v by u, by v), camera px.
#include "bench_texel.glsl"
SHIFTS
uniform sampler2D rays, rest;

layout(location = 0) out vec4 mean;

// (departure of q from rest times light, light) of single rays at a place between pixels; beyond the image its
// border's.
vec3 single(vec2 at, vec2 pitch, vec2 last) {
    at = clamp(at, vec2(0.0), last);
    ivec2 corner = ivec2(min(floor(at), last - 1.0));
    vec2 within = at - vec2(corner);
    vec3 sum = vec3(0.0);
    for (int k = 0; k < 4; ++k) {
        ivec2 step_by = ivec2(k & 1, k >> 1);
        vec4 ray = texel(rays, corner + step_by, pitch);
        vec4 still = texel(rest, corner + step_by, pitch);
        vec2 part = mix(1.0 - within, within, vec2(step_by));
#if PART == 2
        sum.z += part.x * part.y * ray.r;
#else
        float light = part.x * part.y * ray.z * ray.w * still.w;
        sum += vec3(light * (ray.xy - still.xy), light);
#endif
    }
    return sum;
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec2 pitch = pitch_of(rays), last = vec2(textureSize(rays, 0) - 1);
    vec2 s = 2.0 * vec2(pixel) / last - 1.0;
    vec4 shift = shift_0 + shift_1 * s.x + shift_2 * s.y + shift_3 * s.x * s.x + shift_4 * s.x * s.y
        + shift_5 * s.y * s.y;
    float light = 0.0;
    vec2 first = vec2(0.0);
    vec3 second = vec3(0.0);
    for (int k = 0; k < SAMPLES; ++k) {
        int ring = k / ON_RING;
        float radius = sqrt((float(ring) + 0.5) * float(ON_RING) / float(SAMPLES));
        float angle = (float(k) + 0.5 * float(ring % 2)) * 6.28318530718 / float(ON_RING);
        vec2 point = radius * vec2(cos(angle), sin(angle));
        vec3 one = single(vec2(pixel) + vec2(dot(shift.xy, point), dot(shift.zw, point)), pitch, last);
        light += one.z;
        first += one.xy;
        vec2 off = one.z > 0.0 ? one.xy / one.z : vec2(0.0);
        second += one.z * vec3(off.x * off.x, off.x * off.y, off.y * off.y);
    }
#if PART == 2
    mean = vec4(light / float(SAMPLES), 0.0, 0.0, 1.0);
#else
    bool lit = light > 0.0;
    vec2 middle = lit ? first / light : vec2(0.0);
#if PART == 0
    vec4 still = texel(rest, pixel, pitch);
    lit = lit && still.w > 0.0;
    mean = lit ? vec4(still.xy + middle, light / float(SAMPLES), 1.0) : vec4(0.0);
#else
    vec3 spread = second / max(light, 1e-30) - vec3(middle.x * middle.x, middle.x * middle.y, middle.y * middle.y);
    mean = vec4(UNIT * (lit ? vec3(max(spread.x, 0.0), spread.y, max(spread.z, 0.0)) : vec3(0.0)), 0.0);
#endif
#endif
}
