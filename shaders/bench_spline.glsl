// Cubic B-spline of coefficients in a texture whose texels each hold four neighbours of a row, which a pixel needs at once.
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

// (value, d/dcolumn, d/drow) at `cell` + `within` = (column, row), 0 <= within <= 1, of a block of coefficients
// that starts at row `first_row` of the texture; the caller keeps 1 <= cell <= size - 3.
vec3 spline(sampler2D coefficients, int first_row, vec2 cell, vec2 within) {
    vec4 column_values = spline_values(within.x), column_slopes = spline_slopes(within.x);
    vec4 row_values = spline_values(within.y), row_slopes = spline_slopes(within.y);
    ivec2 corner = ivec2(cell) + ivec2(-1, first_row - 1);
    vec2 pitch = pitch_of(coefficients);
    vec3 sum = vec3(0.0);
    for (int j = 0; j < 4; ++j) {
        vec4 c = texel(coefficients, corner + ivec2(0, j), pitch);
        float value = dot(c, column_values);
        sum += vec3(value * row_values[j], dot(c, column_slopes) * row_values[j], value * row_slopes[j]);
    }
    return sum;
}
