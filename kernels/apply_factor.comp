#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "half.glsl"

// window *= factor. x is the pixel (strided), z the frame.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Factor { float factor[]; };
layout(std430, binding = 1) buffer Window { COMPLEX window[]; };
layout(push_constant) uniform Args {
    uint count;
    // Number of values from one frame to the next.
    uint window_stride;
};

void main() {
    uint base = gl_GlobalInvocationID.z * window_stride;
    for (uint i = gl_GlobalInvocationID.x; i < count; i += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        window[base + i] = STORE(LOAD(window[base + i]) * factor[i]);
    }
}
