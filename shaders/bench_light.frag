#version 330 core
// Light at each camera pixel: the LCD's lit apertures, each weighted by what the pixel gets from there.
//
// A camera pixel responds to light that falls beside it because the lens blurs before the pixel collects:
// box (1 px) convolved with a Gaussian (PSF px), along u as along v. A footprint along the LCD's axes keeps
// that a product of both axes and is integrated exactly (for a map that is linear over the footprint). A
// turned or sheared one is cut into 2 x 2 parts of the camera pixel, each such a product, that together have
// the second moments of the whole.
uniform sampler2D rays, footprints, panel;
uniform vec2 fill;          // lit share of the pitch, columns and rows
uniform float scale;        // share of the ray map / (fill.x fill.y)

layout(location = 0) out float light;

const float SKEW = 0.02;    // px of footprint across the axes that is still a box along them
const int MOST = 96;        // LCD px under one footprint and axis; more belongs to no usable node
const float SIGMAS = 4.0;   // the Gaussian is cut there

// Share of the response of a part `WIDTH` camera px wide that lies before x (camera px from its middle).
#if PSF_ON
// Integral of a Gaussian's lower tail from z to infinity, z >= 0: pdf(z) - z cdf(-z), to 4e-6.
vec4 tail(vec4 z) {
    vec4 t = min(z * (2.0 / TAIL_END) - 1.0, 1.0);
    return TAIL_POLYNOMIAL;
}

vec4 before(vec4 x, float width) {
    vec4 right = x + 0.5 * width, left = x - 0.5 * width;
    vec4 rounded = float(PSF) * (tail(abs(right) / PSF) - tail(abs(left) / PSF));
    return (clamp(right, 0.0, width) + rounded) / width;
}
#else
vec4 before(vec4 x, float width) {
    return clamp(x / width + 0.5, 0.0, 1.0);
}
#endif

// Weights of the apertures of four LCD px (columns or rows): `at` (LCD px from the part's middle).
vec4 weights(vec4 at, float lit, float per_px, float width) {
    return before((at + 0.5 * lit) * per_px, width) - before((at - 0.5 * lit) * per_px, width);
}

vec4 column_weights(vec4 at, float per_px, float width) {
#if RGB
    float lit = fill.x / 3.0;
    return weights(at - 1.0 / 3.0, lit, per_px, width) + weights(at, lit, per_px, width)
        + weights(at + 1.0 / 3.0, lit, per_px, width);
#else
    return weights(at, fill.x, per_px, width);
#endif
}

float fetch(int i, int j, ivec2 last) {
    return texelFetch(panel, ivec2(min(i, last.x), j), 0).r;
}

// Light gathered by a part of the pixel, `width` camera px wide, that is `size` LCD px per camera px.
float gathered(vec2 middle, vec2 size, float width, ivec2 last) {
    vec2 reach = (0.5 * width + SIGMAS * PSF) * size, per_px = 1.0 / size;
    ivec2 first = max(ivec2(floor(middle - reach + 0.5)), ivec2(0));
    ivec2 end = min(min(ivec2(floor(middle + reach + 0.5)), last), first + MOST);
    float sum = 0.0;
    const vec4 NEXT = vec4(0.0, 1.0, 2.0, 3.0);
    for (int i = first.x; i <= end.x; i += 8) {
        vec4 at = float(i) + NEXT - middle.x;
        vec4 w0 = column_weights(at, per_px.x, width) * vec4(lessThanEqual(i + ivec4(0,1,2,3), ivec4(last.x)));
        vec4 w1 = column_weights(at + 4.0, per_px.x, width)* vec4(lessThanEqual(i + ivec4(4,5,6,7), ivec4(last.x)));
        for (int j = first.y; j <= end.y; ++j) {
            float w = weights(vec4(float(j) - middle.y), fill.y, per_px.y, width).x;
#if VARIANT == 1
            float row = dot(w0, vec4(fetch(i, j, last), fetch(i + 1, j, last), fetch(i + 2, j, last), fetch(i + 3, j, last)))
              + dot(w1, vec4(fetch(i+4, j, last), fetch(i + 5, j, last), fetch(i + 6, j, last), fetch(i + 7, j, last)));
#elif VARIANT == 2
            float row = dot(w0, texelFetch(panel, ivec2(i, j), 0)) + dot(w1, texelFetch(panel, ivec2(i+4, j), 0));
#elif VARIANT == 3
            vec2 p = vec2(1.0/(last+1)); vec4 a=textureGather(panel, p*vec2(i+1,j+1)), b=textureGather(panel, p*vec2(i+3,j+1)),
             c=textureGather(panel, p*vec2(i+5,j+1)), d=textureGather(panel, p*vec2(i+7,j+1));
            float row = w0.x*a.w+w0.y*a.z+w0.z*b.w+w0.w*b.z+ w1.x*c.w+w1.y*c.z+w1.z*d.w+w1.w*d.z;
#else
            float row = dot(w0,w1);
#endif
            sum += w * row;
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
    // turned by quarter turns is along the axes too
    float skew = min(max(abs(foot.y), abs(foot.z)), max(abs(foot.x), abs(foot.w)));
    int parts = ray.z <= 0.0 ? 0 : skew < SKEW ? 1 : 2;
    float sum = 0.0, width = 1.0 / float(max(parts, 1));
    for (int k = 0; k < parts * parts; ++k) {
        vec2 at = (vec2(k & 1, k >> 1) + 0.5) * width - 0.5;
        sum += gathered(ray.xy + at.x * foot.xy + at.y * foot.zw, size, width, last);
    }
    light = scale * ray.z * sum * width * width;
}
