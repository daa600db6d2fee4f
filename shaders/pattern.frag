#version 330 core
// Grey code of one LCD pixel: the target's light at the camera position whose warp is this pixel.
#define COSINES 0
#define CHECKER 1
#define LATTICE 2
#define NOISE 3
#include "pattern_keys.glsl"

uniform highp sampler2D places;  // lattice position to first order, by pattern_mesh; 0 where there is none
uniform highp sampler2D codes;   // grey codes at equally spaced roots of light
uniform highp sampler2D texture_of_noise;
uniform highp sampler2D lamp;    // per node: 1 where the LCD is white, as the camera sees a contact there
uniform bool lit;                // whether it is anywhere
#if REGIONS
uniform highp sampler2D exponents;  // of the light, from corner to corner of the panel
#endif
uniform vec2 display_px;
uniform vec2 first_px;           // camera position of node (0, 0)
uniform vec2 moved;              // by how much a periodic target is shifted, periods
uniform float facing;            // sign of det dq/du at rest
#if STRIPS
uniform int strip_bits;          // Gray code and check, lowest bit first along the strip
uniform vec2 strip_edges;        // inner edges of the two strips across, camera px
uniform vec4 strip_places;       // start and cell width along, of the first and the second strip
#endif

uniform int coded_parts;         // parts of the LCD over which fringes are drawn
uniform vec4 parts[MOST_PARTS];  // left, top, right, bottom, LCD px
uniform vec3 fringes;            // 0 along columns, 1 along rows; period, LCD px; shift

#if CARRY
uniform highp sampler2D kept_before;     // of the picture before: code; light wanted; light owed
uniform highp sampler2D light_of_codes;  // of whole grey codes

layout(location = 0) out vec4 kept;
#else
layout(location = 0) out vec4 grey;
#endif

const float TAU = 6.283185307179586;

// Camera position = whole + part, px, split so that the phase keeps its digits. Edges pass over one LCD px:
// sampled at LCD pixels, a sharp one would lie half a pixel wrong.
float shape(vec2 whole, vec2 part, vec2 fade, vec2 lcd_px) {
#if KIND == NOISE
    vec2 low = floor(part), t = part - low;
    ivec2 size = textureSize(texture_of_noise, 0);
    ivec2 a = ivec2(mod(whole + low, vec2(size)));
    ivec2 b = (a + 1) % size;
    float upper = mix(texelFetch(texture_of_noise, a, 0).r, texelFetch(texture_of_noise, ivec2(b.x, a.y), 0).r, t.x);
    float lower = mix(texelFetch(texture_of_noise, ivec2(a.x, b.y), 0).r, texelFetch(texture_of_noise, b, 0).r, t.x);
    return min(fade.x, fade.y) * mix(upper, lower, t.y);
#else
    vec2 periods = (mod(whole, PERIOD) + part) / PERIOD + moved;
    vec2 off = abs(periods - round(periods));  // from the middle of the nearest line or square
#if KIND == CHECKER
    vec2 signs = clamp(2.0 * lcd_px * (0.25 - off), -1.0, 1.0);
    return min(fade.x, fade.y) * signs.x * signs.y;
#elif KIND == LATTICE
    vec2 dark = clamp(0.5 - lcd_px * (0.125 - off), 0.0, 1.0);
    return min(fade.x, fade.y) * (1.0 - 2.0 * dark.x * dark.y);
#else
    return 0.5 * dot(fade, cos(TAU * periods));
#endif
#endif
}

float code(float light) {
    float place = sqrt(clamp(light, 0.0, 1.0)) * float(CODES - 1);
    int low = min(int(place), CODES - 2);
    return mix(texelFetch(codes, ivec2(low, 0), 0).r, texelFetch(codes, ivec2(low + 1, 0), 0).r, place - float(low));
}

#if REGIONS
float exponent(vec2 here) {
    ivec2 size = textureSize(exponents, 0);
    vec2 place = here / (display_px - 1.0) * vec2(size - 1);
    ivec2 low = min(ivec2(place), size - 2);
    vec2 t = place - vec2(low);
    vec2 left = vec2(texelFetch(exponents, low, 0).r, texelFetch(exponents, low + ivec2(0, 1), 0).r);
    vec2 right = vec2(texelFetch(exponents, low + ivec2(1, 0), 0).r, texelFetch(exponents, low + 1, 0).r);
    vec2 rows = mix(left, right, t.x);
    return mix(rows.x, rows.y, t.y);
}
#endif

float lamp_share(ivec2 cell, vec2 t) {
    ivec2 last = textureSize(lamp, 0) - 1;
    ivec2 far = cell + ivec2(floor(t));
    ivec2 a = clamp(far, ivec2(0), last), b = clamp(far + 1, ivec2(0), last);
    vec2 part = fract(t);
    float upper = mix(texelFetch(lamp, a, 0).r, texelFetch(lamp, ivec2(b.x, a.y), 0).r, part.x);
    float lower = mix(texelFetch(lamp, ivec2(a.x, b.y), 0).r, texelFetch(lamp, b, 0).r, part.x);
    return mix(upper, lower, part.y);
}

#if STRIPS
// Light of the coded strips at a camera position; negative outside them. A bit's cells: bit, not, not, bit.
float strip_light(vec2 camera) {
    float across = ALONG_U == 1 ? camera.y : camera.x, along = ALONG_U == 1 ? camera.x : camera.y;
    bool first = across < strip_edges.x;
    if (!first && across < strip_edges.y) return -1.0;
    vec2 place = first ? strip_places.xy : strip_places.zw;
    int cell = int(floor((along - place.x) / place.y));
    if (cell < 0 || cell >= 4 * BITS) return MEAN;
    bool inner = cell % 4 == 1 || cell % 4 == 2;
    bool lit = (strip_bits >> (cell / 4) & 1) == 1;
    return MEAN * (lit != inner ? 1.0 + CONTRAST : 1.0 - CONTRAST);
}
#endif

bool in_parts(vec2 here) {
    for (int part = 0; part < coded_parts; part++)
        if (all(greaterThanEqual(here, parts[part].xy)) && all(lessThanEqual(here, parts[part].zw))) return true;
    return false;
}

#if REGIONS
float code_nearest(float light, vec2 here) { return floor(code(pow(max(light, 0.0), 1.0 / exponent(here))) + 0.5); }
#else
float code_nearest(float light, vec2 here) { return floor(code(light) + 0.5); }
#endif

#if CARRY
void show(float light, vec2 here) {
    vec2 before = texelFetch(kept_before, ivec2(gl_FragCoord.xy), 0).yz;
    float wanted = abs(light - before.x) > FORGET_ABOVE ? light : light + before.y;
    float whole = code_nearest(wanted, here);
    float given = texelFetch(light_of_codes, ivec2(int(whole), 0), 0).r;
#if REGIONS
    given = pow(given, exponent(here));
#endif
    kept = vec4(whole, light, clamp(wanted - given, -MOST_OWED, MOST_OWED), 1.0);
}
#else
void show(float light, vec2 here) { grey = vec4(vec3(code_nearest(light, here) / 255.0), 1.0); }
#endif

void main() {
    vec2 here = vec2(gl_FragCoord.x, display_px.y - gl_FragCoord.y) - 0.5;
    if (coded_parts > 0 && in_parts(here)) {
        float place = fringes.x > 0.5 ? here.y : here.x;
        show(MEAN * (1.0 + CONTRAST * cos(TAU * fract(place / fringes.y) - fringes.z)), here);
        return;
    }
    vec2 node = texelFetch(places, ivec2(gl_FragCoord.xy), 0).xy;
    if (node.x == 0.0) discard;
    ivec2 cell = ivec2(node);
    vec2 t = node - vec2(cell);
    Support around = support(cell, here);
    mat2 jacobian;
    for (int step = 0; step < STEPS; step++) {
        jacobian = warp_slope(around, t);
        t -= inverse(jacobian) * warp(around, t);
    }
    float area = determinant(jacobian);
    if (!(area * facing > 0.0)) discard;  // NaN as well: a node of the support has no warp
    // LCD px per period, across the fringes: of the carrier along u, along v.
    vec2 lcd_px = abs(area) * PERIOD / SPACING / vec2(length(jacobian[1]), length(jacobian[0]));
    vec2 fade = smoothstep(FADED_PX, CLEAR_PX, lcd_px);
    float light = MEAN * (1.0 + CONTRAST * shape(first_px + SPACING * vec2(cell), SPACING * t, fade, lcd_px));
    if (lit) light = mix(light, MEAN * (1.0 + CONTRAST), lamp_share(cell, t));
#if STRIPS
    float coded = strip_light(first_px + SPACING * (vec2(cell) + t));
    if (coded >= 0.0) light = coded;
#endif
    show(light, here);
}
