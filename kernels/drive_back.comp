#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "half.glsl"
#include "trig.glsl"

// Back through the look-up table, to the change of a field of the phases themselves. x: column, y: row (strided), z: pair.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Tables { float level[]; };
layout(std430, binding = 1) readonly buffer Shown { float shown[]; };
layout(std430, binding = 2) readonly buffer Wave { vec2 wave[]; };
layout(std430, binding = 3) buffer Change { COMPLEX change[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    float bend_sin, bend_cos, lag;
    // Sub-frames, and values from one frame to the next.
    uint frames, shown_stride, wave_stride, change_stride;
};

vec2 changed(float phase, float l, float tau) {
    vec2 t = cos_sin(wrapped(phase));
    float turn = (l + (bend_sin * t.x + bend_cos * t.y)) * tau;
    return vec2(-turn * t.y, turn * t.x);
}

void main() {
    uint x = gl_GlobalInvocationID.x;
    uint first = 2 * gl_GlobalInvocationID.z;
    if (x >= width) return;
    for (uint y = gl_WorkGroupID.y; y < height; y += gl_NumWorkGroups.y) {
        uint point = (y + top) * grid_width + x + left, pixel = y * width + x;
        vec2 taus = wave[gl_GlobalInvocationID.z * wave_stride + point];
        float l = level[pixel];
        change[first * change_stride + point] = STORE(changed(shown[first * shown_stride + pixel], l, taus.x));
        if (first + 1 < frames) {
            change[(first + 1) * change_stride + point] =
                STORE(changed(shown[(first + 1) * shown_stride + pixel], l, taus.y));
        }
    }
}
