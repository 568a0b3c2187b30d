#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// to = disparities, in which values between two surfaces take the closer one.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer From { float from[]; };
layout(std430, binding = 1) writeonly buffer To { float to[]; };

layout(push_constant) uniform Args { uint height, width; float tear; };

void main() {
    uint pixels = height * width;
    for (uint p = gl_GlobalInvocationID.x; p < pixels; p += gl_NumWorkGroups.x * WIDTH) {
        uint x = p % width, y = p / width;
        float here = from[p], low = here, high = here;
        for (uint j = max(y, 1u) - 1u; j < min(y + 2, height); ++j) {
            for (uint i = max(x, 1u) - 1u; i < min(x + 2, width); ++i) {
                low = min(low, from[j * width + i]);
                high = max(high, from[j * width + i]);
            }
        }
        float closer = high - here < here - low ? high : low;
        to[p] = high - low > tear ? closer : here;
    }
}
