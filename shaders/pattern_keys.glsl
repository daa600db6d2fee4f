// Keys' cubic (a = -1/2) on the node texture: texel (i, j) holds q of the nodes (i, j) and (i + 1, j),
// so that the 4 x 4 support is eight fetches. LCD positions q are in px, (column, row).
uniform highp sampler2D nodes;

vec4 keys(float t) {
    float s = 1.0 - t;
    return vec4(-0.5 * t * s * s, 1.0 + t * t * (1.5 * t - 2.5), 1.0 + s * s * (1.5 * s - 2.5), -0.5 * s * t * t);
}

vec4 keys_slope(float t) {
    return vec4((-1.5 * t + 2.0) * t - 0.5, (4.5 * t - 5.0) * t, (-4.5 * t + 4.0) * t + 0.5, (1.5 * t - 1.0) * t);
}

// The support of a cell, one matrix per lattice row (columns: its four nodes; no array: it would be slow to index). `here` is taken off before
// anything is summed, which keeps the small difference q - here exact in 32 bits.
struct Support { mat4x2 a, b, c, d; };

mat4x2 lattice_line(ivec2 first, vec2 here) {
    vec4 left = texelFetch(nodes, first, 0) - here.xyxy;
    vec4 right = texelFetch(nodes, first + ivec2(2, 0), 0) - here.xyxy;
    return mat4x2(left.xy, left.zw, right.xy, right.zw);
}

Support support(ivec2 cell, vec2 here) {
    ivec2 first = cell - 1;
    return Support(
        lattice_line(first, here),
        lattice_line(first + ivec2(0, 1), here),
        lattice_line(first + ivec2(0, 2), here),
        lattice_line(first + ivec2(0, 3), here));
}

// q(cell + t) - here.
vec2 warp(Support s, vec2 t) {
    vec4 across = keys(t.x);
    return mat4x2(s.a * across, s.b * across, s.c * across, s.d * across) * keys(t.y);
}

// Derivatives per node: mat2(dq/dcolumn, dq/drow).
mat2 warp_slope(Support s, vec2 t) {
    vec4 across = keys(t.x), slope = keys_slope(t.x);
    mat4x2 value = mat4x2(s.a * across, s.b * across, s.c * across, s.d * across);
    mat4x2 along = mat4x2(s.a * slope, s.b * slope, s.c * slope, s.d * slope);
    return mat2(along * keys(t.y), value * keys_slope(t.y));
}
