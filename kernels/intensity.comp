#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "half.glsl"

// image (+)= gain * sum over frames |window|^2. x is the pixel (strided).

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Window { COMPLEX window[]; };
layout(std430, binding = 1) buffer Image { float image[]; };
layout(push_constant) uniform Args {
    uint count, frames;
    float gain;
    uint accumulate;
    // Number of values from one frame to the next.
    uint window_stride;
};

void main() {
    for (uint i = gl_GlobalInvocationID.x; i < count; i += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        float sum = accumulate == 0 ? 0.0 : image[i];
        for (uint frame = 0; frame < frames; ++frame) {
            vec2 v = LOAD(window[frame * window_stride + i]);
            sum += gain * dot(v, v);
        }
        image[i] = sum;
    }
}
