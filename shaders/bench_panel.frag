#version 330 core
// Light of one picture's LCD pixels: response(code) times each row's share of the exposure. Four columns from
// here on, so that one fetch gets four; beyond the panel it is dark.
uniform sampler2D picture;    // (lcd columns, rows) codes 0..1, bottom row first as in a window
uniform sampler2D response;   // (256, 1) light
uniform sampler2D row_share;  // (1, lcd rows)
#if REGIONS
uniform sampler2D exponents;  // (lcd columns, rows) power of the light, row 0 first
#endif

layout(location = 0) out vec4 light;

float light_of(ivec2 drawn, ivec2 size) {
    if (drawn.x >= size.x) return 0.0;
    int code = int(texelFetch(picture, drawn, 0).r * 255.0 + 0.5);
    float light = texelFetch(response, ivec2(code, 0), 0).r;
#if REGIONS
    light = pow(light, texelFetch(exponents, ivec2(drawn.x, size.y - 1 - drawn.y), 0).r);
#endif
    return light;
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy), size = textureSize(picture, 0);
    ivec2 drawn = ivec2(pixel.x, size.y - 1 - pixel.y);
    light = texelFetch(row_share, ivec2(0, pixel.y), 0).r * vec4(
        light_of(drawn, size), light_of(drawn + ivec2(1, 0), size),
        light_of(drawn + ivec2(2, 0), size), light_of(drawn + ivec2(3, 0), size));
}
