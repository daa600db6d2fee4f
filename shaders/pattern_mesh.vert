#version 330 core
// One vertex per node of the lattice, where its warp puts it on the LCD; the outermost nodes, which no
// cell with a whole 4 x 4 support uses, are left out.
uniform highp sampler2D nodes;
uniform int mesh_columns;  // vertices per mesh row
uniform vec2 display_px;   // (columns, rows) of the LCD

noperspective out vec2 node;  // position on the lattice, nodes
noperspective out float hole; // > 0 where a corner has no warp

void main() {
    ivec2 place = 1 + ivec2(gl_VertexID % mesh_columns, gl_VertexID / mesh_columns);
    node = vec2(place);
    vec2 q = texelFetch(nodes, place, 0).xy;
    hole = 0.0;
    if (any(isnan(q)) || any(isinf(q))) {
        hole = 1.0;
        q = vec2(0.0);
    }
    // LCD row 0 is the picture's top line: +1 in clip space.
    vec2 clip = 2.0 * (q + 0.5) / display_px - 1.0;
    gl_Position = vec4(clip.x, -clip.y, 0.0, 1.0);
}
