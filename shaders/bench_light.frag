#version 330 core
// Light at each camera pixel: the LCD's lit apertures, each weighted by the pixel's response to its place.
//
// The lens blurs before the pixel grid samples, so the response to a place on the LCD is box (1 px) convolved
// with Gaussian (psf px) along u and along v, carried to the LCD by the footprint (dq/du, dq/dv). Where that
// lies along the LCD's axes it is a product of both axes, and the integral over each aperture is exact.
// A turned or sheared footprint is replaced by such products with the same second moments: two with a lens,
// apart along the shear (one if only turned); without a lens 2 x 2 boxes, each a quarter of the pixel.
#include "bench_texel.glsl"
uniform sampler2D rays, footprints;
uniform usampler2D panel;   // five columns from here on, see bench_five.frag
uniform float scale;        // light relative to the main ray map

layout(location = 0) out float light;

const vec2 FILL = vec2(FILL_X, FILL_Y);  // lit share of the pitch, columns and rows
const float UNIT = 1.0 / (8388608.0 * FILL_X * FILL_Y);
const int MOST = 256;       // LCD px under one footprint and axis; more belongs to no usable node
#if LENS
const float SHEAR = 0.01;   // correlation of the axes that is left out
#else
const float SKEW = 0.02;    // px of footprint across the axes that is still a box along them
#endif

// Share of the response before x (camera px from its middle), less one half.
float before(float x) {
    x = clamp(x, -REACH, REACH);
#if LENS
    float t = x * x * (2.0 / (REACH * REACH)) - 1.0;
    return x * (RESPONSE);
#else
    return x;
#endif
}

// Response to a strip of half width `half_px` around `at` (camera px from the footprint's middle).
float strip(float at, float half_px) {
    return before(at + half_px) - before(at - half_px);
}

float column_weight(float at, float per_px) {
    at *= per_px;
#if RGB
    float third = per_px / 3.0, half_px = FILL.x / 6.0 * per_px;
    return strip(at - third, half_px) + strip(at, half_px) + strip(at + third, half_px);
#else
    return strip(at, 0.5 * FILL.x * per_px);
#endif
}

// Light of the panel under a response of `size` LCD px per camera px; outside the panel it is dark.
float gathered(vec2 middle, vec2 size, ivec2 last, vec2 pitch) {
    vec2 reach = REACH * size, per_px = 1.0 / size;
    ivec2 first = max(ivec2(floor(middle - reach + 0.5)), ivec2(0));
    ivec2 end = min(min(ivec2(floor(middle + reach + 0.5)), last), first + MOST);
    float half_row = 0.5 * FILL.y * per_px.y;
    float sum = 0.0;
    for (int i = first.x; i <= end.x; i += 5) {
        float at = float(i) - middle.x;
        vec4 four = vec4(
            column_weight(at, per_px.x), column_weight(at + 1.0, per_px.x),
            column_weight(at + 2.0, per_px.x), column_weight(at + 3.0, per_px.x));
        float fifth = column_weight(at + 4.0, per_px.x);
        for (int j = first.y; j <= end.y; ++j) {
            uvec4 five = textureLod(panel, (vec2(i, j) + 0.5) * pitch, 0.0);
            uvec3 high = five.rgb >> 24u;
            // by way of int: on a CPU unsigned numbers are dear to convert
            float row = dot(four, vec4(ivec4(five & 0xffffffu)))
                + fifth * float(int(high.r | (high.g << 8u) | (high.b << 16u)));
            sum += row * strip((float(j) - middle.y) * per_px.y, half_row);
        }
    }
    return UNIT * sum;
}

// From where the pixel's centre looks to its footprint's mean, which differ where the map is bent; 0 at the
// border and next to what is lost.
vec2 off_centre(vec4 ray, ivec2 pixel, vec2 pitch) {
    vec4 sum = texel(rays, pixel - ivec2(1, 0), pitch) + texel(rays, pixel + ivec2(1, 0), pitch)
        + texel(rays, pixel - ivec2(0, 1), pitch) + texel(rays, pixel + ivec2(0, 1), pitch);
    ivec2 last = textureSize(rays, 0) - 1;
    bool inside = all(greaterThan(pixel, ivec2(0))) && all(lessThan(pixel, last)) && sum.w == 4.0;
    return inside ? 0.5 * SPREAD * SPREAD * (sum.xy - 4.0 * ray.xy) : vec2(0.0);
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec2 ray_pitch = pitch_of(rays);
    vec4 ray = texel(rays, pixel, ray_pitch), foot = texel(footprints, pixel, ray_pitch);
    ray.xy += off_centre(ray, pixel, ray_pitch);
    ivec2 last = textureSize(panel, 0) - 1;
    vec2 pitch = 1.0 / vec2(last + 1);
    // where rays cross a footprint vanishes
    vec2 size = max(sqrt(foot.xy * foot.xy + foot.zw * foot.zw), 2e-2);
    float sum = 0.0;
    // no branches: on a CPU all of them would run. No rounds where no light comes
#if LENS
    float shear = clamp((foot.x * foot.y + foot.z * foot.w) / (size.x * size.y), -0.99, 0.99);
    int rounds = ray.z <= 0.0 ? 0 : abs(shear) < SHEAR ? 1 : 2;
    vec2 apart = rounds < 2 ? vec2(0.0) : SPREAD * sqrt(abs(shear)) * size * vec2(1.0, sign(shear));
    size *= rounds < 2 ? 1.0 : sqrt(1.0 - abs(shear));
    for (int k = 0; k < rounds; ++k) {
        sum += gathered(ray.xy + float(1 - 2 * k) * apart, size, last, pitch);
    }
    sum /= float(max(rounds, 1));
#else
    // turned by quarter turns is along the axes too
    float skew = min(max(abs(foot.y), abs(foot.z)), max(abs(foot.x), abs(foot.w)));
    int parts = ray.z <= 0.0 ? 0 : skew < SKEW ? 1 : 2;
    float part = 1.0 / float(max(parts, 1));
    for (int k = 0; k < parts * parts; ++k) {
        vec2 at = (vec2(k & 1, k >> 1) + 0.5) * part - 0.5;
        sum += gathered(ray.xy + at.x * foot.xy + at.y * foot.zw, part * size, last, pitch);
    }
    sum *= part * part;
#endif
#if LAMP
    // the lamp's light came the same way, as dense as the mirror focuses it
    float seen_px2 = abs(foot.x * foot.w - foot.y * foot.z);
    sum *= ray.z * min(LAMP_PX2 / max(seen_px2, 1e-6), MOST_FOCUS);
#endif
    light = scale * ray.z * sum;
}
