// Closed forms of one dent each, added to depth d > 0 into the rubber and its gradient (dd/dx, dd/dy).
// x, y: mm from the middle of the mirror. Numbers that do not depend on the place come from the CPU.
#include "bench_spline.glsl"

const float HALF_PI = 1.57079632679;

// asin on 0..1 to 1e-7 (least-squares polynomial); the driver's own may be good to 1e-4 only.
float arc_sine(float x) {
    bool small = x <= 0.5;
    float z = small ? x : sqrt(0.5 * (1.0 - x));
    float w = z * z;
    float p = 1.0 + w * (0.16666786 + w * (0.07494535 + w * (0.04553898 + w * (0.0239094 + w * 0.04255367))));
    return small ? z * p : HALF_PI - 2.0 * z * p;
}

// Error function, |error| < 2e-7. Source: Abramowitz and Stegun 1964, formula 7.1.26.
float error_function(float x) {
    float t = 1.0 / (1.0 + 0.3275911 * abs(x));
    float p = t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))));
    return sign(x) * (1.0 - p * exp(-x * x));
}

// place = (x, y, d0, 1 / 2 sigma^2)
void gaussian(vec2 at, vec4 place, inout vec3 field) {
    vec2 r = at - place.xy;
    float depth = place.z * exp(-dot(r, r) * place.w);
    field += vec3(depth, -2.0 * place.w * depth * r);
}

// Hertz. place = (x, y, d0, a), shape.x = 1 / pi a^2
void ball(vec2 at, vec4 place, vec4 shape, inout vec3 field) {
    vec2 to = at - place.xy;
    float r2 = dot(to, to), a = place.w, a2 = a * a;
    if (r2 <= a2) {
        field += vec3(place.z * (1.0 - 0.5 * r2 / a2), -place.z / a2 * to);
    } else {
        float r = sqrt(r2), root = sqrt((r - a) * (r + a)), angle = arc_sine(a / r);
        float scale = place.z * shape.x;
        float depth = scale * ((2.0 * a2 - r2) * angle + a * root);
        field += vec3(depth, 2.0 * scale * (a * root / r2 - angle) * to);
    }
}

// Sneddon. place = (x, y, d0, a), shape.x = 2 d0 / pi a
void cone(vec2 at, vec4 place, vec4 shape, inout vec3 field) {
    vec2 to = at - place.xy;
    float r = length(to), a = place.w;
    if (r <= a) {
        field += vec3(place.z - shape.x * r, r > 0.0 ? -shape.x / r * to : vec2(0.0));
    } else {
        float root = sqrt((r - a) * (r + a));
        float fall = a * a / (r + root);
        field += vec3(shape.x * (a * arc_sine(a / r) - fall), -shape.x * fall / (r * r) * to);
    }
}

// place = (x, y, d0, 1 / sqrt2 sigma), turn = (cos, sin, L / 2, d0 / 2 erf(L / 2 sqrt2 sigma))
void edge(vec2 at, vec4 place, vec4 turn, inout vec3 field) {
    vec2 r = at - place.xy;
    float along = dot(r, turn.xy), across = turn.x * r.y - turn.y * r.x;
    float plus = (along + turn.z) * place.w, minus = (along - turn.z) * place.w;
    float cross_profile = turn.w * exp(-across * across * place.w * place.w);
    float depth = cross_profile * (error_function(plus) - error_function(minus));
    float by_along = cross_profile * 1.12837916710 * place.w * (exp(-plus * plus) - exp(-minus * minus));
    float by_across = -2.0 * across * place.w * place.w * depth;
    field += vec3(depth, by_along * turn.xy + by_across * vec2(-turn.y, turn.x));
}

// place = (x, y, d0, 1 / pitch), turn = (cos, sin, columns, rows), first row in the texture
void height_map(vec2 at, vec4 place, vec4 turn, sampler2D coefficients, float first_row, inout vec3 field) {
    vec2 r = at - place.xy;
    vec2 to = vec2(dot(r, turn.xy), turn.x * r.y - turn.y * r.x);
    vec2 sample_at = to * place.w + 0.5 * (turn.zw - 1.0);
    if (all(greaterThanEqual(sample_at, vec2(1.0))) && all(lessThan(sample_at, turn.zw - 2.0))) {
        vec3 value = place.z * spline(coefficients, int(first_row), floor(sample_at), fract(sample_at));
        vec2 slope = value.yz * place.w;
        field += vec3(value.x, slope.x * turn.xy + slope.y * vec2(-turn.y, turn.x));
    }
}

// Round about its middle: d0 u D(u), slope over r = d0 / s^2 u^3 G(u), u = 1 / sqrt(1 + r^2 / s^2).
// place = (x, y, d0, 1 / s^2), shape.x: places from u = 0 to 1, less one; splines of D and, a row below, of G
void radial(vec2 at, vec4 place, vec4 shape, sampler2D tables, float first_row, inout vec3 field) {
    vec2 r = at - place.xy;
    float u2 = 1.0 / (1.0 + dot(r, r) * place.w);
    float u = sqrt(u2), to = u * shape.x, cell = min(floor(to), shape.x - 1.0);
    ivec2 corner = ivec2(int(cell), int(first_row));
    vec2 pitch = pitch_of(tables);
    vec4 weights = spline_values(to - cell);
    float depth = place.z * u * dot(texel(tables, corner, pitch), weights);
    float over_r = place.z * place.w * u * u2 * dot(texel(tables, corner + ivec2(0, 1), pitch), weights);
    field += vec3(depth, over_r * r);
}

// A map even in x / sqrt(size^2 + x^2). place = (x, y, d0, 1 / size), turn = (cos, sin, columns, rows), first row in the texture
void whole_plane(vec2 at, vec4 place, vec4 turn, sampler2D coefficients, float first_row, inout vec3 field) {
    vec2 r = (at - place.xy) * place.w;
    vec2 to = vec2(dot(r, turn.xy), turn.x * r.y - turn.y * r.x);
    vec2 near = inversesqrt(1.0 + to * to), half_size = 0.5 * (turn.zw - 1.0);
    vec2 sample_at = half_size * (1.0 + to * near);
    if (all(greaterThanEqual(sample_at, vec2(1.0))) && all(lessThan(sample_at, turn.zw - 2.0))) {
        vec3 value = place.z * spline(coefficients, int(first_row), floor(sample_at), fract(sample_at));
        vec2 slope = value.yz * half_size * near * near * near * place.w;
        field += vec3(value.x, slope.x * turn.xy + slope.y * vec2(-turn.y, turn.x));
    }
}

// Share of the reflection left where the object touches; 1 elsewhere. touch = (contact, reflectance, , half a line's length).
float round_touch(vec2 at, vec4 place, vec4 touch) {
    return distance(at, place.xy) < touch.x ? touch.y : 1.0;
}

float straight_touch(vec2 at, vec4 place, vec4 turn, vec4 touch) {
    vec2 r = at - place.xy;
    bool covered = abs(turn.x * r.y - turn.y * r.x) < touch.x && abs(dot(r, turn.xy)) < touch.w;
    return covered ? touch.y : 1.0;
}
