#version 330 core
// Light at each camera pixel: the LCD's lit apertures integrated over the pixel's footprint.
//
// A footprint along the LCD's axes is a box and integrated exactly. A turned or sheared one is cut into
// 2 x 2 parts of the camera pixel, each a box of the same area moments.
uniform sampler2D rays, footprints, panel;
uniform vec2 fill;          // lit share of the pitch, columns and rows
uniform float scale;        // share of the ray map / (fill.x fill.y)

layout(location = 0) out float light;

const float SKEW = 0.02;    // px of footprint across the axes that is still a box along them
const int MOST = 64;        // LCD px under one box and axis; more belongs to no usable node

float overlap(float from, float to, float centre, float width) {
    return max(0.0, min(to, centre + 0.5 * width) - max(from, centre - 0.5 * width));
}

// Lit length of column (px) between from and to.
float lit_column(float from, float to, float column) {
#if RGB
    float width = fill.x / 3.0;
    return overlap(from, to, column - 1.0 / 3.0, width) + overlap(from, to, column, width)
        + overlap(from, to, column + 1.0 / 3.0, width);
#else
    return overlap(from, to, column, fill.x);
#endif
}

// Mean over a box of the lit panel; outside the panel it is dark.
float box(vec2 middle, vec2 size, ivec2 last) {
    vec2 low = middle - 0.5 * size, high = middle + 0.5 * size;
    ivec2 first = max(ivec2(floor(low + 0.5)), ivec2(0));
    ivec2 end = min(min(ivec2(floor(high + 0.5)), last), first + MOST);
    float sum = 0.0;
    for (int j = first.y; j <= end.y; ++j) {
        float row = 0.0;
        for (int i = first.x; i <= end.x; ++i) {
            row += lit_column(low.x, high.x, float(i)) * texelFetch(panel, ivec2(i, j), 0).r;
        }
        sum += row * overlap(low.y, high.y, float(j), fill.y);
    }
    return sum / (size.x * size.y);
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 ray = texelFetch(rays, pixel, 0);
    vec4 foot = texelFetch(footprints, pixel, 0);
    ivec2 last = textureSize(panel, 0) - 1;
    // where rays cross a footprint vanishes
    vec2 size = max(sqrt(foot.xy * foot.xy + foot.zw * foot.zw), 2e-2);
    // turned by quarter turns is along the axes too
    float skew = min(max(abs(foot.y), abs(foot.z)), max(abs(foot.x), abs(foot.w)));
    // no branches: on a CPU all of them would run. Parts per side; none where no light comes
    int parts = ray.z <= 0.0 ? 0 : skew < SKEW ? 1 : 2;
    float sum = 0.0, part_size = 1.0 / float(max(parts, 1));
    for (int k = 0; k < parts * parts; ++k) {
        vec2 at = (vec2(k & 1, k >> 1) + 0.5) * part_size - 0.5;
        sum += box(ray.xy + at.x * foot.xy + at.y * foot.zw, part_size * size, last);
    }
    light = scale * ray.z * sum * part_size * part_size;
}
