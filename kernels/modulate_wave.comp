#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "half.glsl"
#include "trig.glsl"

// field = scale (amplitude exp(i W) + rest) on the SLM, zero around it. x: column, y: row (strided), z: pair.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Wave { vec2 wave[]; };
// Level, amplitude, real and imaginary part of the rest.
layout(std430, binding = 1) readonly buffer Tables { float tables[]; };
layout(std430, binding = 2) writeonly buffer Field { COMPLEX field[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    float scale;
    // Sub-frames, and values from one frame to the next.
    uint frames, wave_stride, field_stride;
};

void main() {
    uint x = gl_GlobalInvocationID.x;
    uint first = 2 * gl_GlobalInvocationID.z;
    if (x >= grid_width) return;
    uint pixels = height * width;
    for (uint y = gl_WorkGroupID.y; y < grid_height; y += gl_NumWorkGroups.y) {
        vec2 one = vec2(0.0), two = vec2(0.0);
        uint at = y * grid_width + x;
        if (y - top < height && x - left < width) {
            uint pixel = (y - top) * width + (x - left);
            vec2 phases = wave[gl_GlobalInvocationID.z * wave_stride + at];
            float a = tables[pixels + pixel];
            vec2 rest = vec2(tables[2 * pixels + pixel], tables[3 * pixels + pixel]);
            one = scale * (a * cos_sin(phases.x) + rest);
            two = scale * (a * cos_sin(phases.y) + rest);
        }
        field[first * field_stride + at] = STORE(one);
        if (first + 1 < frames) field[(first + 1) * field_stride + at] = STORE(two);
    }
}
