#version 330 core
// Light at each camera pixel: the LCD's lit apertures, each weighted by the pixel's response to its place.
//
// The lens blurs before the pixel grid samples, so the response to a place on the LCD is box (1 px) convolved
// with Gaussian (psf px) along u and along v, carried to the LCD by the footprint (dq/du, dq/dv). Where that
// lies along the LCD's axes it is a product of both axes, and the integral over each aperture is exact.
// A turned or sheared footprint is replaced by such products with the same second moments: two with a lens,
// apart along the shear (one if only turned); without a lens 2 x 2 boxes, each a quarter of the pixel.
uniform sampler2D rays, footprints;
uniform sampler2D panel;    // light of four columns from here on
uniform vec2 fill;          // lit share of the pitch, columns and rows
uniform float scale;        // share of the ray map / (fill.x fill.y)

layout(location = 0) out float light;

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

// Response to a strip of `width` LCD px around `at` (LCD px from the footprint's middle).
float strip(float at, float width, float per_px) {
    return before((at + 0.5 * width) * per_px) - before((at - 0.5 * width) * per_px);
}

float column_weight(float at, float per_px) {
#if RGB
    float width = fill.x / 3.0;
    return strip(at - 1.0 / 3.0, width, per_px) + strip(at, width, per_px) + strip(at + 1.0 / 3.0, width, per_px);
#else
    return strip(at, fill.x, per_px);
#endif
}

// Light of the panel under a response of `size` LCD px per camera px; outside the panel it is dark.
float gathered(vec2 middle, vec2 size, ivec2 last) {
    vec2 reach = REACH * size, per_px = 1.0 / size;
    ivec2 first = max(ivec2(floor(middle - reach + 0.5)), ivec2(0));
    ivec2 end = min(min(ivec2(floor(middle + reach + 0.5)), last), first + MOST);
    float sum = 0.0;
    // five columns at once: on a CPU a fetch costs as much as ten multiplications
    for (int i = first.x; i <= end.x; i += 5) {
        float at = float(i) - middle.x;
        vec4 four = vec4(
            column_weight(at, per_px.x), column_weight(at + 1.0, per_px.x),
            column_weight(at + 2.0, per_px.x), column_weight(at + 3.0, per_px.x));
        float fifth = i + 4 <= last.x ? column_weight(at + 4.0, per_px.x) : 0.0;
        for (int j = first.y; j <= end.y; ++j) {
            float row = dot(four, texelFetch(panel, ivec2(i, j), 0))
                + fifth * texelFetch(panel, ivec2(min(i + 4, last.x), j), 0).r;
            sum += row * strip(float(j) - middle.y, fill.y, per_px.y);
        }
    }
    return sum;
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 ray = texelFetch(rays, pixel, 0);
    vec4 foot = texelFetch(footprints, pixel, 0);
    ivec2 last = textureSize(panel, 0) - 1;
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
        sum += gathered(ray.xy + float(1 - 2 * k) * apart, size, last);
    }
    sum /= float(max(rounds, 1));
#else
    // turned by quarter turns is along the axes too
    float skew = min(max(abs(foot.y), abs(foot.z)), max(abs(foot.x), abs(foot.w)));
    int parts = ray.z <= 0.0 ? 0 : skew < SKEW ? 1 : 2;
    float part = 1.0 / float(max(parts, 1));
    for (int k = 0; k < parts * parts; ++k) {
        vec2 at = (vec2(k & 1, k >> 1) + 0.5) * part - 0.5;
        sum += gathered(ray.xy + at.x * foot.xy + at.y * foot.zw, part * size, last);
    }
    sum *= part * part;
#endif
    light = scale * ray.z * sum;
}
