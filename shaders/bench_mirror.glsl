// The mirror's surface z(x, y): the rest surface less the dents. x, y in mm from the mirror's middle.
// rest_sphere, rest_off_axis and rest_grid are among the rig's constants. The CPU writes the calls of the dents that there are: EACH_DENT (field) and EACH_TOUCH (factor).
#include "bench_dents.glsl"

// The program is made for the shapes of one mirror: DENTS of them (at least 1), REST 0 flat, 1 sphere, 2 map, 3 cylinder.
uniform vec4 dent_place[DENTS];
uniform vec4 dent_shape[DENTS];
uniform vec4 dent_more[DENTS];  // contact mm, touch reflectance, first row of the map, half a line's length mm
uniform sampler2D dent_maps;

#if REST == 2
uniform sampler2D rest_map;
#endif

// (z, dz/dx, dz/dy) of the rest surface.
vec3 rest_surface(vec2 at) {
#if REST == 1 || REST == 3
    vec2 r = at - rest_sphere.xy;
#if REST == 3
    r = dot(r, rest_off_axis) * rest_off_axis;
#endif
    float root = sign(rest_sphere.z) * sqrt(rest_sphere.z * rest_sphere.z - dot(r, r));
    return vec3(-dot(r, r) / (rest_sphere.z + root), -r / root);
#elif REST == 2
    vec2 to = (at - rest_grid.xy) / rest_grid.z;
    vec2 size = vec2(textureSize(rest_map, 0)) + vec2(3.0, 0.0);
    vec2 inside = clamp(to, vec2(1.0), size - 2.0);  // beyond the map its border's heights go on
    vec2 cell = min(floor(inside), size - 3.0);
    vec3 value = spline(rest_map, 0, cell, inside - cell);
    return vec3(value.x, value.yz / rest_grid.z * vec2(equal(to, inside)));
#else
    return vec3(0.0);
#endif
}

vec3 surface(vec2 at) {
    vec3 field = vec3(0.0);
    EACH_DENT
    return rest_surface(at) - field;
}

// Share of the reflection left by what touches.
float touch(vec2 at) {
    float left = 1.0;
    EACH_TOUCH
    return left;
}

// Most steps; a uniform, because compilers unroll a fixed number and then run them all.
uniform int newton_steps;

// Where a ray from inside the rubber meets the mirror: `from` on it, `direction` unit. Newton from the
// plane z = 0; steps are counted from there so that heights lose no digits. False: it never does.
bool meet_mirror(vec3 from, vec3 direction, out vec3 point, out vec3 normal) {
    point = from;
    normal = vec3(0.0, 0.0, 1.0);
    if (direction.z <= 1e-6) {
        return false;
    }
    vec2 start = from.xy - from.z / direction.z * direction.xy;
    float way = 0.0;
    vec3 here = vec3(0.0);
    bool met = false;
    for (int i = 0; i < newton_steps; ++i) {
        here = surface(start + way * direction.xy);
        float step_back = (way * direction.z - here.x) / (direction.z - dot(here.yz, direction.xy));
        way -= step_back;
        met = abs(step_back) < 1e-5;
        if (met) {
            break;
        }
    }
    point = vec3(start, 0.0) + way * direction;
    normal = normalize(vec3(-here.yz, 1.0));
    return met;
}
