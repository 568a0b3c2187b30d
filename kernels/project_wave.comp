#version 450
#extension GL_GOOGLE_include_directive : require
#include "alias.glsl"
#include "constants.glsl"
#include "trig.glsl"

// `lag_back`, `drive_back` and `project`, of one sub-pixel: the change of the field that they hand on is stored nowhere.
// x: pixel (strided).

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Tables { float level[]; };
// The phases that made the field: the same buffer as `phases` where nothing is quantised.
MAY_ALIAS layout(std430, binding = 1) readonly buffer Shown { uint shown[]; };
layout(std430, binding = 2) readonly buffer Wave { float wave[]; };
MAY_ALIAS layout(std430, binding = 3) buffer Phases { uint phases[]; };
layout(std430, binding = 4) buffer Velocity { uint velocity[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    float gain, momentum, bound;
    uint step_count;
    float bend_sin, bend_cos, lag;
    // (1 - h) / (1 - h^frames)
    float settled;
    // Values from one frame to the next; pixels.
    uint frames, phases_stride, wave_stride, first, count;
};

#include "project.glsl"

void main() {
    for (uint i = gl_GlobalInvocationID.x; i < count; i += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        uint k = first + i;
        precise float state = 0.0;
        for (uint t = frames; t-- > 0;) state = state * lag + wave[t * wave_stride + k];
        state *= settled;
        for (uint t = frames; t-- > 0;) {
            state = (1.0 - lag) * wave[t * wave_stride + k] + lag * state;
            uint base = t * phases_stride;
            vec2 z = cos_sin(wrapped(uintBitsToFloat(shown[base + k])));
            float turn = (level[k] + (bend_sin * z.x + bend_cos * z.y)) * state;
            move(base, k, vec2(-turn * z.y, turn * z.x));
        }
    }
}
