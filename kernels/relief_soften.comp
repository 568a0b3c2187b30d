#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "relief.glsl"

// hidden = the continued far surface, averaged over 3 x 3 pixels.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Filled { float filled[]; };
layout(std430, binding = 1) writeonly buffer Hidden { float hidden[]; };

layout(push_constant) uniform Args { RELIEF_ARGS };

vec3 color(uint pixel) {
    uint at = plane + 3 * pixel;
    return vec3(filled[at], filled[at + 1], filled[at + 2]);
}

void main() {
    ivec2 size = RELIEF_SIZE;
    uint pixels = uint(size.x * size.y);
    for (uint p = gl_GlobalInvocationID.x; p < pixels; p += gl_NumWorkGroups.x * WIDTH) {
        float here = filled[p], count = 1.0;
        vec3 sum = color(p);
        if (here > RELIEF_ABSENT) {
            ivec2 place = place_of(p, size);
            for (uint n = 0; n < 8; ++n) {
                if (!is_inside(place + AROUND[n], size)) continue;
                uint q = pixel_of(place + AROUND[n], size);
                if (filled[q] > RELIEF_ABSENT && is_like(filled[q], here, tear)) {
                    sum += color(q);
                    count += 1.0;
                }
            }
        }
        hidden[p] = here;
        for (uint k = 0; k < 3; ++k) hidden[plane + 3 * p + k] = sum[k] / count;
    }
}
