// Cubic B-spline of coefficients in a texture: twice differentiable, 16 fetches.
#include "bench_texel.glsl"

vec4 spline_values(float t) {
    float s = 1.0 - t;
    return vec4(
        s * s * s / 6.0,
        2.0 / 3.0 - 0.5 * t * t * (2.0 - t),
        2.0 / 3.0 - 0.5 * s * s * (2.0 - s),
        t * t * t / 6.0);
}

vec4 spline_slopes(float t) {
    float s = 1.0 - t;
    return vec4(-0.5 * s * s, t * (1.5 * t - 2.0), s * (2.0 - 1.5 * s), 0.5 * t * t);
}

// Four texels of a row, from `corner` on.
vec4 four_texels(sampler2D source, ivec2 corner, vec2 pitch) {
    return vec4(
        texel(source, corner, pitch).r,
        texel(source, corner + ivec2(1, 0), pitch).r,
        texel(source, corner + ivec2(2, 0), pitch).r,
        texel(source, corner + ivec2(3, 0), pitch).r);
}

// (value, d/dcolumn, d/drow) at `cell` + `within` = (column, row), 0 <= within <= 1, of a block of coefficients
// that starts at row `first_row` of the texture; the caller keeps 1 <= cell <= size - 3.
vec3 spline(sampler2D coefficients, int first_row, vec2 cell, vec2 within) {
    vec4 column_values = spline_values(within.x), column_slopes = spline_slopes(within.x);
    vec4 row_values = spline_values(within.y), row_slopes = spline_slopes(within.y);
    ivec2 corner = ivec2(cell) + ivec2(-1, first_row - 1);
    vec2 pitch = pitch_of(coefficients);
    vec3 sum = vec3(0.0);
    for (int j = 0; j < 4; ++j) {
        vec4 c = four_texels(coefficients, corner + ivec2(0, j), pitch);
        float value = dot(c, column_values);
        sum += vec3(value * row_values[j], dot(c, column_slopes) * row_values[j], value * row_slopes[j]);
    }
    return sum;
}
