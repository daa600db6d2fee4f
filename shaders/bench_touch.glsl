// Objects in contact: the light that crosses the gap between mirror and object, and what they scatter of it.
// CLOTH: between the two lies a cloth, whose threads take the light instead. TOUCHES: how many objects there are. Levels are gap^(2/3) in mm^(2/3), below 0 in contact, one lattice below the other.
#if TOUCHES || CLOTH
#include "bench_texel.glsl"
#endif
#if CLOTH
uniform vec4 cloth_place;   // x, y mm of a point of the weave, cos and sin of its angle over mm from point to point
uniform vec4 cloth_points;  // radius at rest and pressed, width of the border: over the weave; 1 / give, 1 / mm
uniform float cloth_albedo;
uniform sampler2D cloth_weave;

// Share of the light that threads take at a point of the mirror; `gap` mm to what presses.
float threads(vec2 at, float gap) {
    vec2 r = at - cloth_place.xy, turn = cloth_place.zw;
    vec2 to = vec2(dot(r, turn), turn.x * r.y - turn.y * r.x);
    vec2 point = floor(to + 0.5);
    vec2 pitch = pitch_of(cloth_weave);
    vec3 own = texel(cloth_weave, ivec2(point - floor(point * pitch) / pitch), pitch).xyz;
    float squeezed = exp(-gap * cloth_points.w), loose = 1.0 - squeezed;
    float radius = cloth_points.x * (1.0 + own.z) * loose + cloth_points.y * squeezed;
    return clamp((radius - length(to - point - loose * own.xy)) / cloth_points.z + 0.5, 0.0, 1.0);
}
#endif
#if TOUCHES
uniform vec4 touch_place[TOUCHES];  // x, y mm, 1 / pitch, first row of the levels
uniform vec4 touch_turn[TOUCHES];   // cos, sin, columns, rows
uniform float touch_albedo[TOUCHES];
uniform sampler2D touch_levels;
#endif

// (share of the reflection left, share of the light scattered) at a point of the mirror.
// per_gap: 1 / mm, how fast the light that crosses falls with the gap.
vec2 touched(vec2 at, float per_gap) {
    vec2 light = vec2(1.0, 0.0);
    float gap = 1e3;
#if TOUCHES
    vec2 pitch = pitch_of(touch_levels);
    for (int k = 0; k < TOUCHES; ++k) {
        vec4 place = touch_place[k], turn = touch_turn[k];
        vec2 r = at - place.xy;
        vec2 to = vec2(dot(r, turn.xy), turn.x * r.y - turn.y * r.x) * place.z + 0.5 * (turn.zw - 1.0);
        if (all(greaterThanEqual(to, vec2(0.0))) && all(lessThan(to, turn.zw - 1.0))) {
            ivec2 corner = ivec2(to) + ivec2(0, int(place.w));
            vec2 within = fract(to);
            vec2 upper = vec2(
                texel(touch_levels, corner, pitch).r, texel(touch_levels, corner + ivec2(1, 0), pitch).r);
            vec2 lower = vec2(
                texel(touch_levels, corner + ivec2(0, 1), pitch).r,
                texel(touch_levels, corner + ivec2(1, 1), pitch).r);
            vec2 across = mix(upper, lower, within.y);
            float level = max(mix(across.x, across.y, within.x), 0.0);
            gap = min(gap, level * sqrt(level));
            float crossing = exp(-per_gap * level * sqrt(level));
            light = vec2(light.x * (1.0 - crossing), light.y + touch_albedo[k] * crossing);
        }
    }
#endif
#if CLOTH
    float taken = threads(at, gap);
    light = vec2(1.0 - taken, cloth_albedo * taken);
#endif
    return light;
}
