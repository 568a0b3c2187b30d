#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "half.glsl"

// energy[patch] += sum |field|^2 over the values begin .. end of the patch and all sub-frames. x is the patch, with one
// workgroup each. A patch is summed in shares, so an invocation adds only a few thousand values. In a longer sum
// float32 loses small values, and some software devices leave a loop after 65535 iterations.

layout(local_size_x = SUM_WIDTH) in;
layout(std430, binding = 0) readonly buffer Field { COMPLEX field[]; };
layout(std430, binding = 1) buffer Energy { float energy[]; };
layout(push_constant) uniform Args {
    uint grid_height, grid_width, y0, x0, rows, columns, patches, accumulate;
    // Number of sub-frames, and of values from one to the next.
    uint frames, field_stride;
    uint begin, end;
};

shared float parts[SUM_WIDTH];

void main() {
    uint a = gl_WorkGroupID.x / patches, b = gl_WorkGroupID.x % patches;
    uint top = a * rows / patches, left = b * columns / patches;
    uint height = (a + 1) * rows / patches - top, width = (b + 1) * columns / patches - left;
    uint last = min(end, height * width);
    float sum = 0.0;
    for (uint f = 0; f < frames; f++) {
        for (uint i = begin + gl_LocalInvocationID.x; i < last; i += SUM_WIDTH) {
            uint y = (y0 + top + i / width) % grid_height;
            uint x = (x0 + left + i % width) % grid_width;
            vec2 z = LOAD(field[f * field_stride + y * grid_width + x]);
            sum += dot(z, z);
        }
    }
    parts[gl_LocalInvocationID.x] = sum;
    for (uint half_size = SUM_WIDTH / 2; half_size > 0; half_size /= 2) {
        barrier();
        if (gl_LocalInvocationID.x < half_size) {
            parts[gl_LocalInvocationID.x] += parts[gl_LocalInvocationID.x + half_size];
        }
    }
    if (gl_LocalInvocationID.x == 0) {
        energy[gl_WorkGroupID.x] = parts[0] + (accumulate != 0 ? energy[gl_WorkGroupID.x] : 0.0);
    }
}
