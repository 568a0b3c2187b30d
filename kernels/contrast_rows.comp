#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// Differences of contrast, filtered along rows. x: column, y: row (strided).

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Weights { float weights[]; };
layout(std430, binding = 1) readonly buffer Image { float image[]; };
layout(std430, binding = 2) readonly buffer Target { float target_image[]; };
layout(std430, binding = 3) writeonly buffer Contrast { float contrast[]; };
#include "contrast.glsl"

float at(uint y, uint x) {
    uint i = y * columns + x;
    float filtered = has_gaze() ? sqrt(1.0 - sharp(y, x)) : 1.0;
    return filtered * difference(image[i], target_image[i]);
}

void main() {
    uint x = gl_GlobalInvocationID.x, first = reach_y + 1;
    if (x >= columns) return;
    for (uint y = gl_WorkGroupID.y; y < rows; y += gl_NumWorkGroups.y) {
        float sum = weights[first] * at(y, x);
        for (uint t = 1; t <= reach_x; t++) {
            sum += weights[first + t] * (at(y, (x + columns - t) % columns) + at(y, (x + t) % columns));
        }
        contrast[y * columns + x] = sum;
    }
}
