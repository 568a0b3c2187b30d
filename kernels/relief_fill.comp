#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "relief.glsl"

// filled = the surface behind the one in front, which is its mirror image at the rim of a tear.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Front { float front[]; };
layout(std430, binding = 1) readonly buffer Nearest { uint nearest[]; };
layout(std430, binding = 2) writeonly buffer Filled { float filled[]; };

layout(push_constant) uniform Args { RELIEF_ARGS };

// Multiples of the distance of the rim, and pixels that are added.
const vec2 TRIES[5] = vec2[](vec2(2.0, 2.0), vec2(1.5, 2.0), vec2(1.0, 3.0), vec2(1.0, 2.0), vec2(1.0, 1.0));

void main() {
    ivec2 size = RELIEF_SIZE;
    uint pixels = uint(size.x * size.y);
    for (uint p = gl_GlobalInvocationID.x; p < pixels; p += gl_NumWorkGroups.x * WIDTH) {
        uint packed = nearest[plane + p];
        float level = RELIEF_ABSENT;
        vec3 color = vec3(0.0);
        if (packed != RELIEF_NOWHERE) {
            ivec2 place = place_of(p, size), offset = rim_offset(packed);
            uint taken = pixel_of(place + offset, size);
            level = front[taken];
            vec2 toward = vec2(offset);
            // Along an axis, the direction is exact.
            bool is_along = offset.x == 0 || offset.y == 0;
            vec2 unit = is_along ? sign(toward) : toward / sqrt(dot(toward, toward));
            for (uint i = 0; i < 5; ++i) {
                vec2 away = toward * TRIES[i].x + unit * TRIES[i].y;
                ivec2 at = place + ivec2(sign(away) * floor(abs(away) + 0.5));
                if (is_inside(at, size) && is_like(front[pixel_of(at, size)], level, tear)) {
                    taken = pixel_of(at, size);
                    break;
                }
            }
            color = vec3(front[plane + 3 * taken], front[plane + 3 * taken + 1], front[plane + 3 * taken + 2]);
        }
        filled[p] = level;
        for (uint k = 0; k < 3; ++k) filled[plane + 3 * p + k] = color[k];
    }
}
