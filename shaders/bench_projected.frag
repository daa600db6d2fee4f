#version 330 core
// Light of a projector's picture on the cloth by one way to the camera: see SCATTERED of bench_rays.frag.
uniform sampler2D way, picture;
uniform vec3 to_px[3];      // rows of the homography from mm from the mirror's middle to the picture's pixels
uniform float scale;        // luminance of a picture's light of 1

layout(location = 0) out float light;

#include "bench_texel.glsl"

void main() {
    vec4 seen = texel(way, ivec2(gl_FragCoord.xy), pitch_of(way));
    vec3 place = vec3(seen.yz, 1.0);
    vec3 px = vec3(dot(to_px[0], place), dot(to_px[1], place), dot(to_px[2], place));
    vec2 at = px.xy / px.z, pitch = pitch_of(picture), last = vec2(textureSize(picture, 0) - 1);
    bool inside = px.z > 0.0 && all(greaterThanEqual(at, vec2(-0.5))) && all(lessThanEqual(at, last + 0.5));
    at = clamp(at, vec2(0.0), last);
    ivec2 corner = ivec2(min(floor(at), last - 1.0));
    vec2 within = at - vec2(corner);
    vec2 upper = vec2(texel(picture, corner, pitch).r, texel(picture, corner + ivec2(1, 0), pitch).r);
    vec2 lower = vec2(
        texel(picture, corner + ivec2(0, 1), pitch).r, texel(picture, corner + ivec2(1, 1), pitch).r);
    vec2 across = mix(upper, lower, within.y);
    light = inside ? scale * seen.w * mix(across.x, across.y, within.x) : 0.0;
}
