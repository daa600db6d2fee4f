#version 330 core
// The picture drawn before, as grey codes of the LCD.
uniform highp sampler2D kept;  // code, 0 .. 255; light wanted; light owed

layout(location = 0) out vec4 grey;

void main() {
    grey = vec4(vec3(texelFetch(kept, ivec2(gl_FragCoord.xy), 0).r / 255.0), 1.0);
}
