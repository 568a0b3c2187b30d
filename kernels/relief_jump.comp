#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "relief.glsl"

// to = the offsets to the nearest rim, and to the nearest rim that is farther from the camera, from the ones of the
// neighbors at some distance.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Front { float front[]; };
layout(std430, binding = 1) readonly buffer From { uint from[]; };
layout(std430, binding = 2) writeonly buffer To { uint to[]; };

layout(push_constant) uniform Args { RELIEF_ARGS uint step_size; };

int length_of(uint packed) {
    ivec2 offset = rim_offset(packed);
    return packed == RELIEF_NOWHERE ? 0x7fffffff : offset.x * offset.x + offset.y * offset.y;
}

void main() {
    ivec2 size = RELIEF_SIZE;
    uint pixels = uint(size.x * size.y);
    int most = int(reach);
    for (uint p = gl_GlobalInvocationID.x; p < pixels; p += gl_NumWorkGroups.x * WIDTH) {
        ivec2 place = place_of(p, size);
        uint near = from[p], own = from[plane + p];
        int near_length = length_of(near), own_length = length_of(own);
        float below = front[p] - tear;
        for (uint n = 0; n < 8; ++n) {
            ivec2 by = int(step_size) * AROUND[n];
            if (!is_inside(place + by, size)) continue;
            uint q = pixel_of(place + by, size);
            for (uint k = 0; k < 2; ++k) {
                uint candidate = from[k * plane + q];
                if (candidate == RELIEF_NOWHERE) continue;
                ivec2 offset = rim_offset(candidate) + by;
                // The products of larger numbers would not fit.
                if (any(greaterThan(abs(offset), ivec2(most)))) continue;
                int square = offset.x * offset.x + offset.y * offset.y;
                if (square > most * most || square >= max(near_length, own_length)) continue;
                uint found = (uint(offset.x) & 0xffffu) | uint(offset.y) << 16;
                if (square < near_length) {
                    near = found;
                    near_length = square;
                }
                if (square < own_length && front[pixel_of(place + offset, size)] < below) {
                    own = found;
                    own_length = square;
                }
            }
        }
        to[p] = near;
        to[plane + p] = own;
    }
}
