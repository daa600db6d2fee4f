#version 330 core
// One triangle over the whole target: fragment (i + 0.5, j + 0.5) is pixel (column i, row j).
void main() {
    vec2 corner = vec2((gl_VertexID << 1) & 2, gl_VertexID & 2);
    gl_Position = vec4(2.0 * corner - 1.0, 0.0, 1.0);
}
