// Texels of textures that are neither filtered nor repeated, by textureLod instead of texelFetch: Mesa's software
// renderer works out size and pitch of a mipmap level for each fetch and pixel, which costs more than the fetch.
// `pitch` is 1 / size of the texture; the caller keeps it out of loops. Beyond the border its texels go on.
vec2 pitch_of(sampler2D source) {
    return 1.0 / vec2(textureSize(source, 0));
}

vec4 texel(sampler2D source, ivec2 at, vec2 pitch) {
    return textureLod(source, (vec2(at) + 0.5) * pitch, 0.0);
}
