#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "trig.glsl"

// `drive` and `lag`, of one sub-pixel. x: pixel (strided).

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Shown { float shown[]; };
layout(std430, binding = 1) readonly buffer Tables { float level[]; };
layout(std430, binding = 2) writeonly buffer Wave { float wave[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    float bend_sin, bend_cos, lag;
    // (1 - h) / (1 - h^frames)
    float settled;
    // Values from one frame to the next; pixels.
    uint frames, shown_stride, wave_stride, first, count;
};

#include "driven.glsl"

void main() {
    for (uint i = gl_GlobalInvocationID.x; i < count; i += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        uint k = first + i;
        precise float state = 0.0;
        for (uint t = 0; t < frames; t++) state = state * lag + driven(shown[t * shown_stride + k], level[k]);
        state *= settled;
        for (uint t = 0; t < frames; t++) {
            state = (1.0 - lag) * driven(shown[t * shown_stride + k], level[k]) + lag * state;
            wave[t * wave_stride + k] = state;
        }
    }
}
