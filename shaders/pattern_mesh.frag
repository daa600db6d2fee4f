#version 330 core
// First pass: the position on the node lattice that an LCD pixel belongs to, to first order.
noperspective in vec2 node;
noperspective in float hole;
layout(location = 0) out vec2 place;

void main() {
    if (hole > 0.0) discard;
    place = node;
}
