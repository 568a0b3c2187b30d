#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// Closes the gaps of a view of a relief with the farther one of the two sides.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) buffer Views { float views[]; };
layout(std430, binding = 1) readonly buffer Seen { vec2 seen[]; };

// The direction of the parallax is (x, y). The other arguments have the same meaning as in relief_draw.comp.
layout(push_constant) uniform Args {
    uint height, width;
    float x, y;
    uint colors, places, first, stride;
};

// Returns the nearest known pixel in a direction, or a negative number.
int search(uint p, vec2 by) {
    vec2 from = vec2(p % width, p / width);
    for (uint k = 1; k < width + height; ++k) {
        precise vec2 at = from + float(k) * by;
        // Places are not negative, or they are outside.
        ivec2 place = ivec2(floor(at + 0.5));
        if (any(lessThan(place, ivec2(0))) || place.x >= int(width) || place.y >= int(height)) return -1;
        int q = place.y * int(width) + place.x;
        if (seen[q].x > RELIEF_KNOWN) return q;
    }
    return -1;
}

void main() {
    uint pixels = height * width;
    for (uint p = gl_GlobalInvocationID.x; p < pixels; p += gl_NumWorkGroups.x * WIDTH) {
        float covered = seen[p].x;
        if (covered > RELIEF_KNOWN) continue;
        int ahead = search(p, vec2(x, y)), behind = search(p, -vec2(x, y));
        int taken = ahead < 0 ? behind : ahead;
        if (ahead >= 0 && behind >= 0 && seen[behind].y < seen[ahead].y) taken = behind;
        if (taken < 0) continue;
        for (uint k = 0; k < colors; ++k) {
            uint plane = (places >> (8 * k) & 255u) * stride + first;
            precise float color = views[plane + p] + (1.0 - covered) * views[plane + uint(taken)];
            views[plane + p] = color;
        }
    }
}
