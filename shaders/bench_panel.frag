#version 330 core
// Light of one picture's LCD pixels: response(code) times each row's share of the exposure.
uniform sampler2D picture;    // (lcd columns, rows) codes 0..1, bottom row first as in a window
uniform sampler2D response;   // (256, 1) light
uniform sampler2D row_share;  // (1, lcd rows)

layout(location = 0) out float light;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    ivec2 drawn = ivec2(pixel.x, textureSize(picture, 0).y - 1 - pixel.y);
    int code = int(texelFetch(picture, drawn, 0).r * 255.0 + 0.5);
    light = texelFetch(row_share, ivec2(0, pixel.y), 0).r * texelFetch(response, ivec2(code, 0), 0).r;
}
