#version 330 core
// Where each camera pixel looks: LCD position q (px), reflectance, and whether the ray arrives.
//
// Light is followed backwards, from the camera: air, camera layers, rubber, mirror, rubber, pattern layers,
// LCD. Lengths in mm from the mirror's middle, which keeps float32 to a few 1e-6 mm.
// GHOST 0: the main ray. 1: reflected again by the LCD's glass and the near side of its gap. 2: reflected
// inside at the pattern face and at the camera face, so that it meets the mirror three times.
// SCATTERED 1: instead of all that, (light that objects in contact scatter where the pixel's ray meets the mirror; with
// CLOTH x, y of that place, and the share that comes from there of the light that a projector casts on the cloth).
// 2: the last three where it meets the mirror again, sent back by pattern face and glass.
// The rig's numbers are constants that the CPU writes, RIG: as uniforms they would be looked up for each pixel, and
// on a CPU that costs more than all rays.
//   camera_face_..., pattern_...: edge, along, normal, length of the faces
//   half_mirror: half length along x, half width along y; rubber_index
//   camera_axis, camera_u, camera_v; camera_centre px; camera_scale: 1 / focal px, or mm per px; k1, k2, p1, p2, k3
//   entry: where the optical axis meets the outermost plane on the camera side; entry_way: mm from the camera to there
//   camera_layers, inner_layers: (index, mm) each; camera_stack, inner_stack: mm of them all
//   last_index, last_mm: the last slab in front of the LCD is apart: its thickness may vary
//   lcd_centre, lcd_column, lcd_row, lcd_normal, lcd_field, lcd_middle px, lcd_pitch
//   rest_sphere: centre x, y, radius (> 0 bulges out of the rubber), of a cylinder as well, whose axis is at right angles
//   to rest_off_axis; rest_grid: x, y of the first coefficient, pitch
RIG
#include "bench_mirror.glsl"
#include "bench_touch.glsl"

struct Face {
    vec3 edge;      // its point on the mirror at y = 0
    vec3 along;     // from there to the apex
    vec3 normal;    // out of the rubber
    float length;
};
const Face camera_face = Face(camera_face_edge, camera_face_along, camera_face_normal, camera_face_length);
const Face pattern = Face(pattern_edge, pattern_along, pattern_normal, pattern_length);

layout(location = 0) out vec4 ray;

bool on_face(Face face, vec3 point) {
    float offset = dot(point - face.edge, face.along);
    return offset >= 0.0 && offset <= face.length && abs(point.y) <= half_mirror.y;
}

bool on_mirror(vec3 point) {
    return all(lessThanEqual(abs(point.xy), half_mirror));
}

// Ideal normalised coordinates of distorted ones: Newton on OpenCV's model (k1, k2, p1, p2, k3).
// False beyond the model's turning point, where no pixel has any.
bool undistort(vec2 distorted, out vec2 at) {
    at = distorted;
    vec2 miss = vec2(0.0);
#if DISTORTED
    for (int i = 0; i < 8; ++i) {
        float x = at.x, y = at.y, r2 = dot(at, at);
        float radial = r2 * (k1 + r2 * (k2 + r2 * k3));
        float growth = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3));
        vec2 shift = radial * at + vec2(
            2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y);
        miss = (distorted - at) - shift;
        float xx = 1.0 + radial + growth * x * x + 2.0 * p1 * y + 6.0 * p2 * x;
        float yy = 1.0 + radial + growth * y * y + 6.0 * p1 * y + 2.0 * p2 * x;
        float xy = growth * x * y + 2.0 * p1 * x + 2.0 * p2 * y;
        at += vec2(yy * miss.x - xy * miss.y, xx * miss.y - xy * miss.x) / (xx * yy - xy * xy);
    }
#endif
    return dot(miss, miss) < 1e-10;
}

// The pixel's ray where it meets the plane of the outermost camera layer, and its unit direction.
bool camera_ray(vec2 pixel, out vec3 from, out vec3 direction) {
    vec2 off = (pixel - camera_centre) * camera_scale;
#if ORTHOGRAPHIC
    vec3 across = off.x * camera_u + off.y * camera_v;
    direction = camera_axis;
    from = entry + across - dot(camera_face.normal, across) / dot(camera_face.normal, camera_axis) * camera_axis;
    return true;
#else
    vec2 at;
    bool settled = undistort(off, at);
    vec3 across = at.x * camera_u + at.y * camera_v;
    float facing = dot(camera_face.normal, camera_axis), turned = dot(camera_face.normal, across);
    float way = entry_way * facing / (facing + turned);
    from = entry + way * across - entry_way * turned / (facing + turned) * camera_axis;
    direction = normalize(camera_axis + across);
    return settled;
#endif
}

// Power reflectance of the mirror for the LCD's polarisation; `travel` leaves it towards the LCD.
float reflectance(float cosine, vec3 travel, vec3 normal) {
    float n = rubber_index, transmitted2 = 1.0 - n * n * (1.0 - cosine) * (1.0 + cosine);
    if (transmitted2 <= 0.0) {
        return 1.0;
    }
    float transmitted = sqrt(transmitted2);
    float s = (n * cosine - transmitted) / (n * cosine + transmitted);
    float p = (cosine - n * transmitted) / (cosine + n * transmitted);
#if POLARISED
    vec3 field = lcd_field - dot(lcd_field, travel) * travel;
    vec3 s_axis = cross(travel, normal);
    float size = dot(field, field) * dot(s_axis, s_axis), part = dot(field, s_axis);
    float share = size > 0.0 ? part * part / size : 0.5;
#else
    float share = 0.5;
#endif
    return mix(p * p, s * s, share);
}

// How fast light that crosses a gap behind the mirror falls with it, 1 / mm; 550 nm. Below the critical angle and
// next to it as for a wave that reaches 0.9 um.
float per_gap(float cosine) {
    float beyond = rubber_index * rubber_index * (1.0 - cosine * cosine) - 1.0;
    return 22847.947 * sqrt(max(beyond, 0.01));
}

// One reflection off the mirror; `light` loses what is not reflected.
bool reflect_off_mirror(inout vec3 at, inout vec3 direction, inout float light) {
    vec3 normal, from = at;
    if (!meet_mirror(from, direction, at, normal) || !on_mirror(at)) {
        return false;
    }
    float cosine = dot(direction, normal);
    direction -= 2.0 * cosine * normal;
    light *= touch(at.xy) * touched(at.xy, per_gap(cosine)).x * reflectance(cosine, direction, normal);
    return cosine > 0.0;
}

#if TEETH
#include "bench_saw.glsl"
#else
// Through the camera layers into the rubber; index x tangential direction is the same in every slab.
bool enter_rubber(inout vec3 at, inout vec3 direction) {
    float inward = -dot(direction, camera_face.normal);
    if (inward <= 0.0) {
        return false;
    }
    vec3 tangent = direction + inward * camera_face.normal;
    float t2 = dot(tangent, tangent);
    at -= camera_stack * camera_face.normal;
#if CAMERA_LAYERS > 0
    for (int i = 0; i < CAMERA_LAYERS; ++i) {
        float n2 = camera_layers[i].x * camera_layers[i].x - t2;
        if (n2 <= 0.0) {
            return false;
        }
        at += tangent * (camera_layers[i].y * inversesqrt(n2));
    }
#endif
    direction = (tangent - camera_face.normal * sqrt(rubber_index * rubber_index - t2)) / rubber_index;
    return on_face(camera_face, at);
}

bool go_to_face(Face face, inout vec3 at, vec3 direction) {
    float outward = dot(direction, face.normal);
    at += dot(face.edge - at, face.normal) / outward * direction;
    return outward > 0.0 && on_face(face, at);
}

// From the pattern face to the LCD's plane; q in px.
bool leave_to_lcd(vec3 at, vec3 direction, out vec2 q) {
    vec3 tangent = rubber_index * (direction - dot(direction, pattern.normal) * pattern.normal);
    float t2 = dot(tangent, tangent);
    at += inner_stack * pattern.normal;
#if INNER_LAYERS > 0
    for (int i = 0; i < INNER_LAYERS; ++i) {
        float n2 = inner_layers[i].x * inner_layers[i].x - t2;
        if (n2 <= 0.0) {
            return false;
        }
        at += tangent * (inner_layers[i].y * inversesqrt(n2));
    }
#endif
    float n2 = last_index * last_index - t2;
    if (n2 <= 0.0) {
        return false;
    }
    vec3 last = tangent + sqrt(n2) * pattern.normal;
    vec3 offset = at - lcd_centre;
    float towards = dot(last, lcd_normal);
    float back = dot(offset, lcd_normal) / towards;
    offset -= back * last;
#if GHOST == 1
    offset += 2.0 * last_mm * inversesqrt(n2) * tangent;
#endif
    q = vec2(dot(offset, lcd_column), dot(offset, lcd_row)) / lcd_pitch + lcd_middle;
    // a tilted panel may cut into the stack
    return towards > 0.0 && back <= 1e-4;
}

bool trace(vec2 pixel, out vec2 q, out float light) {
    vec3 at, direction;
    light = 1.0;
    q = vec2(0.0);
    if (!camera_ray(pixel, at, direction) || !enter_rubber(at, direction) || !reflect_off_mirror(at, direction, light)
        || !go_to_face(pattern, at, direction)) {
        return false;
    }
#if GHOST == 2
    direction = reflect(direction, pattern.normal);
    if (!reflect_off_mirror(at, direction, light) || !go_to_face(camera_face, at, direction)) {
        return false;
    }
    direction = reflect(direction, camera_face.normal);
    if (!reflect_off_mirror(at, direction, light) || !go_to_face(pattern, at, direction)) {
        return false;
    }
#endif
    return leave_to_lcd(at, direction, q);
}
#endif

#if SCATTERED
vec4 scattered(vec2 pixel) {
    vec3 from, at, direction, normal;
    float light = 1.0;
    bool meets = camera_ray(pixel, from, direction) && enter_rubber(from, direction);
#if SCATTERED == 2
    meets = meets && reflect_off_mirror(from, direction, light);
    from += dot(pattern.edge - from, pattern.normal) / dot(direction, pattern.normal) * direction;
    meets = meets && on_face(pattern, from);
    direction = reflect(direction, pattern.normal);
    light *= SENT_BACK;
#endif
    if (!meets || !meet_mirror(from, direction, at, normal) || !on_mirror(at)) {
        return vec4(0.0);
    }
    float cosine = dot(direction, normal);
    vec2 here = touched(at.xy, per_gap(cosine));
#if CLOTH
    float taken = 1.0 - here.x;
    light *= THREADS_VIEW * taken + here.x * (1.0 - reflectance(cosine, direction, normal));
#endif
    return vec4(SCATTERED_VIEW * here.y, at.xy, light);
}
#endif

void main() {
#if SCATTERED
    ray = scattered(floor(gl_FragCoord.xy));
    return;
#endif
    vec2 q;
    float light;
    bool arrives = trace(floor(gl_FragCoord.xy), q, light);
    ray = arrives ? vec4(q, light, 1.0) : vec4(0.0);
}
