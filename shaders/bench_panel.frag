#version 330 core
// Light of one picture's LCD pixels: response(code) times each row's share of the exposure.
#include "bench_texel.glsl"
uniform sampler2D picture;    // (lcd columns, rows) codes 0..1, bottom row first as in a window
uniform sampler2D response;   // (256, 1) light
uniform sampler2D row_share;  // (1, lcd rows)
#if REGIONS
uniform sampler2D exponents;  // (lcd columns, rows) power of the light, row 0 first
#endif

layout(location = 0) out float light;

void main() {
    vec2 size = vec2(textureSize(picture, 0));
    vec2 at = gl_FragCoord.xy / size;
    float code = textureLod(picture, vec2(at.x, 1.0 - at.y), 0.0).r * 255.0;
    light = textureLod(response, vec2((code + 0.5) / 256.0, 0.5), 0.0).r;
#if REGIONS
    light = pow(light, textureLod(exponents, at, 0.0).r);
#endif
    light *= textureLod(row_share, vec2(0.5, at.y), 0.0).r;
}
