#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "trig.glsl"

// From phases to the phases that their drive gives; two sub-frames are one complex one. x: column, y: row (strided), z: pair.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Shown { float shown[]; };
layout(std430, binding = 1) readonly buffer Tables { float level[]; };
layout(std430, binding = 2) writeonly buffer Wave { vec2 wave[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    float bend_sin, bend_cos, lag;
    // Sub-frames, and values from one frame to the next.
    uint frames, shown_stride, wave_stride;
};

float driven(float phase, float l) {
    float w = wrapped(phase);
    precise float value = l * w;
    if (bend_sin != 0.0 || bend_cos != 0.0) {
        vec2 t = cos_sin(w);
        value += bend_sin * t.y + bend_cos * (1.0 - t.x);
    }
    return value;
}

void main() {
    uint x = gl_GlobalInvocationID.x;
    uint first = 2 * gl_GlobalInvocationID.z;
    if (x >= grid_width) return;
    for (uint y = gl_WorkGroupID.y; y < grid_height; y += gl_NumWorkGroups.y) {
        vec2 value = vec2(0.0);
        if (y - top < height && x - left < width) {
            uint at = (y - top) * width + (x - left);
            value.x = driven(shown[first * shown_stride + at], level[at]);
            if (first + 1 < frames) value.y = driven(shown[(first + 1) * shown_stride + at], level[at]);
        }
        wave[gl_GlobalInvocationID.z * wave_stride + y * grid_width + x] = value;
    }
}
