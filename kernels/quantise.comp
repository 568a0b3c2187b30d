#version 450
#extension GL_GOOGLE_include_directive : require
#include "trig.glsl"

// shown = the level nearest to the phase, around the circle, or a share of the way to it. x is the pixel (strided), z
// the frame.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Phases { float phases[]; };
layout(std430, binding = 1) readonly buffer Levels { float level_phases[]; };
layout(std430, binding = 2) writeonly buffer Shown { float shown[]; };
layout(push_constant) uniform Args {
    uint count, levels;
    float hardness;
    // Number of values from one frame to the next, in both buffers.
    uint stride;
};

float distance_round(float a, float b) {
    float off = abs(a - b);
    return min(off, TURN - off);
}

void main() {
    uint base = gl_GlobalInvocationID.z * stride;
    for (uint i = gl_GlobalInvocationID.x; i < count; i += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        float phase = phases[base + i];
        uint low = 0, high = levels;
        while (low < high) {
            uint middle = (low + high) / 2;
            if (level_phases[middle] < phase) low = middle + 1; else high = middle;
        }
        float below = level_phases[(low + levels - 1) % levels];
        float above = level_phases[low % levels];
        float level = distance_round(phase, below) <= distance_round(phase, above) ? below : above;
        shown[base + i] = hardness == 1.0 ? level : wrap(phase + hardness * wrap(level - phase));
    }
}
