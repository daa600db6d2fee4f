#version 330 core
// Light of five LCD columns from here on in one texel, so that one fetch gets them; beyond the panel it is dark.
// Each is a number of 24 bits, 2^23 = light 1: four in the channels' low bits, the fifth in the high bytes.
#include "bench_texel.glsl"
uniform sampler2D light;  // (lcd columns, rows)

layout(location = 0) out uvec4 five;

const float ONE = 8388608.0, MOST = 16777215.0;

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec2 pitch = pitch_of(light);
    uint columns[5];
    for (int i = 0; i < 5; ++i) {
        ivec2 next = at + ivec2(i, 0);
        float there = texel(light, next, pitch).r * float(next.x < textureSize(light, 0).x);
        columns[i] = uint(clamp(there * ONE + 0.5, 0.0, MOST));
    }
    five = uvec4(columns[0], columns[1], columns[2], columns[3]);
    five.rgb |= ((uvec3(columns[4]) >> uvec3(0u, 8u, 16u)) & 255u) << 24u;
}
