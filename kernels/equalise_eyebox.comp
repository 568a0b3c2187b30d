#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "half.glsl"

// change += factor of the patch * field, inside the eyebox's disc of patches. x is the column, y the row (strided) and
// z the frame.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Energy { float energy[]; };
layout(std430, binding = 1) readonly buffer Field { COMPLEX field[]; };
layout(std430, binding = 2) buffer Change { COMPLEX change[]; };
layout(push_constant) uniform Args {
    uint grid_height, grid_width, y0, x0, rows, columns, patches, accumulate;
    uint mode;
    float weight, limit;
    // Number of values from one frame to the next, in both buffers.
    uint stride;
};

shared float factors[ENERGY_MOST * ENERGY_MOST];
shared float mean, variance, number;

bool counts(uint i) {
    int a = 2 * int(i / patches) + 1 - int(patches), b = 2 * int(i % patches) + 1 - int(patches);
    return a * a + b * b <= int(patches * patches);
}

void main() {
    uint count = patches * patches;
    for (uint i = gl_LocalInvocationID.x; i < count; i += gl_WorkGroupSize.x) factors[i] = energy[i];
    barrier();
    if (gl_LocalInvocationID.x == 0) {
        float n = 0.0, sum = 0.0, squares = 0.0;
        for (uint i = 0; i < count; i++) {
            if (counts(i)) {
                n += 1.0;
                sum += factors[i];
            }
        }
        mean = sum / max(n, 1.0);
        for (uint i = 0; i < count && mean > 0.0; i++) {
            if (counts(i)) squares += (factors[i] / mean - 1.0) * (factors[i] / mean - 1.0);
        }
        variance = squares / max(n, 1.0);
        number = n;
    }
    barrier();
    for (uint i = gl_LocalInvocationID.x; i < count; i += gl_WorkGroupSize.x) {
        float e = factors[i];
        float factor = 0.0;
        if (counts(i) && mean > 0.0) {
            if (mode == EQUALISE_PROJECTION) {
                factor = weight * (min(sqrt(mean / max(e, SMALLEST)), limit) - 1.0);
            } else {
                factor = 2.0 * weight / (number * mean) * (e / mean - 1.0 - variance);
            }
        }
        factors[i] = factor;
    }
    barrier();
    uint k = gl_GlobalInvocationID.x;
    if (k >= columns) return;
    // The patch that contains column k. This is the inverse of p * columns / patches, rounded down.
    uint b = ((k + 1) * patches - 1) / columns;
    uint x = (x0 + k) % grid_width;
    uint base = gl_GlobalInvocationID.z * stride;
    for (uint j = gl_WorkGroupID.y; j < rows; j += gl_NumWorkGroups.y) {
        uint a = ((j + 1) * patches - 1) / rows;
        uint at = base + (y0 + j) % grid_height * grid_width + x;
        change[at] = STORE(LOAD(change[at]) + factors[a * patches + b] * LOAD(field[at]));
    }
}
