#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "half.glsl"
#include "trig.glsl"

// wave = Im(change conj(amplitude exp(i wave))) on the SLM, zero around it. x: column, y: row (strided), z: pair.

layout(local_size_x = WIDTH) in;
// Level, amplitude, real and imaginary part of the rest.
layout(std430, binding = 0) readonly buffer Tables { float tables[]; };
layout(std430, binding = 1) readonly buffer Change { COMPLEX change[]; };
layout(std430, binding = 2) buffer Wave { vec2 wave[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    // Sub-frames, and values from one frame to the next.
    uint frames, change_stride, wave_stride;
};

float tau(float a, float phase, uint at) {
    vec2 t = cos_sin(phase), g = LOAD(change[at]);
    return a * (t.x * g.y - t.y * g.x);
}

void main() {
    uint x = gl_GlobalInvocationID.x;
    uint first = 2 * gl_GlobalInvocationID.z;
    if (x >= grid_width) return;
    for (uint y = gl_WorkGroupID.y; y < grid_height; y += gl_NumWorkGroups.y) {
        uint point = y * grid_width + x, at = gl_GlobalInvocationID.z * wave_stride + point;
        vec2 value = vec2(0.0);
        if (y - top < height && x - left < width) {
            float a = tables[height * width + (y - top) * width + (x - left)];
            vec2 phases = wave[at];
            value.x = tau(a, phases.x, first * change_stride + point);
            if (first + 1 < frames) value.y = tau(a, phases.y, (first + 1) * change_stride + point);
        }
        wave[at] = value;
    }
}
