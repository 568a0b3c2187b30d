#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "half.glsl"

// change /= max(hits, 1)^power. x is the point of the grid (strided), z the frame.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Hits { float hits[]; };
layout(std430, binding = 1) buffer Change { COMPLEX change[]; };
layout(push_constant) uniform Args {
    uint grid_height, grid_width;
    float power;
    // Number of values from one frame to the next.
    uint change_stride;
};

void main() {
    uint count = grid_height * grid_width;
    uint base = gl_GlobalInvocationID.z * change_stride;
    for (uint i = gl_GlobalInvocationID.x; i < count; i += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        float n = hits[i];
        if (n <= 1.0) continue;
        float factor = power == 1.0 ? 1.0 / n : power == 0.5 ? 1.0 / sqrt(n) : pow(n, -power);
        change[base + i] = STORE(LOAD(change[base + i]) * factor);
    }
}
