// Rays through a saw, face by face: whatever face of whatever tooth comes next. So light that goes astray by a
// neighbouring tooth, or straight through without the mirror, arrives where it does.
// The rig's constants have the teeth's faces: tooth_pattern_..., tooth_camera_...: edge, along, normal;
// tooth_lengths: of both, mm.

uniform int most_faces;         // a uniform, because compilers unroll a fixed number
const float OFF_FACE = 1e-4;    // mm from a face that a ray just left
const float NONE = 1e9;

// Distance to a face that is crossed from the rubber's side or towards it, NONE where it is not.
float to_face(vec3 edge, vec3 along, vec3 normal, float length_mm, vec3 at, vec3 direction, bool inside) {
    float outward = dot(direction, normal);
    float distance_mm = dot(edge - at, normal) / outward;
    vec3 met = at + distance_mm * direction;
    float offset = dot(met - edge, along);
    bool meets = (inside ? outward > 0.0 : outward < 0.0) && distance_mm > OFF_FACE && offset >= 0.0
        && offset <= length_mm && abs(met.y) <= half_mirror.y;
    return meets ? distance_mm : NONE;
}

// Distance to the next face and its normal.
float next_face(vec3 at, vec3 direction, bool inside, out vec3 normal) {
    float nearest = NONE;
    normal = vec3(0.0);
    for (int k = 0; k < TEETH; ++k) {
        float pattern_mm = to_face(tooth_pattern_edge[k], tooth_pattern_along[k], tooth_pattern_normal[k],
            tooth_lengths[k].x, at, direction, inside);
        float camera_mm = to_face(tooth_camera_edge[k], tooth_camera_along[k], tooth_camera_normal[k],
            tooth_lengths[k].y, at, direction, inside);
        float least = min(pattern_mm, camera_mm);
        if (least < nearest) {
            nearest = least;
            normal = pattern_mm < camera_mm ? tooth_pattern_normal[k] : tooth_camera_normal[k];
        }
    }
    return nearest;
}

// Through a face, or back from it where that is total; share of light that goes there, unpolarised.
float cross_face(inout vec3 direction, inout bool inside, vec3 normal) {
    float ratio = inside ? rubber_index : 1.0 / rubber_index;
    vec3 against = inside ? -normal : normal;
    float cosine = -dot(direction, against), beyond2 = 1.0 - ratio * ratio * (1.0 - cosine * cosine);
    if (beyond2 <= 0.0) {
        direction = reflect(direction, normal);
        return 1.0;
    }
    float beyond = sqrt(beyond2);
    direction = normalize(ratio * direction + (ratio * cosine - beyond) * against);
    inside = !inside;
    float s = (ratio * cosine - beyond) / (ratio * cosine + beyond);
    float p = (cosine - ratio * beyond) / (cosine + ratio * beyond);
    return 1.0 - 0.5 * (s * s + p * p);
}

// From in front of the teeth into the rubber.
bool enter_rubber(inout vec3 at, inout vec3 direction) {
    vec3 normal;
    bool inside = false;
    at -= 2.0 * direction;  // tips may stand out of the plane that they are on
    float distance_mm = next_face(at, direction, inside, normal);
    at += distance_mm * direction;
    cross_face(direction, inside, normal);
    return distance_mm < NONE;
}

bool trace(vec2 pixel, out vec2 q, out float light) {
    vec3 at, direction, normal;
    light = 1.0;
    q = vec2(0.0);
    if (!camera_ray(pixel, at, direction) || !enter_rubber(at, direction)) {
        return false;
    }
    bool inside = true;
    int crossed = 1;
    for (int i = 0; i < most_faces; ++i) {
        float distance_mm = next_face(at, direction, inside, normal);
        if (distance_mm == NONE && inside && direction.z > 0.0) {
            if (!reflect_off_mirror(at, direction, light)) {
                return false;
            }
        } else if (distance_mm == NONE) {
            float towards = dot(direction, lcd_normal);
            vec3 offset = at - lcd_centre;
            offset -= dot(offset, lcd_normal) / towards * direction;
            q = vec2(dot(offset, lcd_column), dot(offset, lcd_row)) / lcd_pitch + lcd_middle;
            return !inside && towards > 0.0;
        } else {
            at += distance_mm * direction;
            // into the rubber and out of it all light loses as much, nearly; further faces take more
            bool before = inside;
            float share = cross_face(direction, inside, normal);
            crossed += before == inside ? 0 : 1;
            light *= crossed > 2 ? share : 1.0;
        }
    }
    return false;
}
