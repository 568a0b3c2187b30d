#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// target = separable weights over the accumulator, periodic. x is the column, y the row (strided) and z the pupil.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Input { float values[]; };
// For each axis, `first` per output sample, then the bits of `weights`, `taps` per output sample.
layout(std430, binding = 1) readonly buffer Tables { uint table[]; };
layout(std430, binding = 2) writeonly buffer Output { float result[]; };
#define PUPILS 3
#include "pupils.glsl"
layout(push_constant) uniform Args {
    // First value of each bound range.
    uint accumulator_base, pixels_base;
    uint members[BATCH];
};

void main() {
    Pupil p = pupils[members[gl_WorkGroupID.z]];
    uint x = gl_GlobalInvocationID.x;
    if (x >= p.columns) return;
    uint from = p.accumulator - accumulator_base, to = p.pixels - pixels_base;
    uint first_x = table[p.column_weights + x];
    for (uint y = gl_WorkGroupID.y; y < p.rows; y += gl_NumWorkGroups.y) {
        uint first_y = table[p.row_weights + y];
        float sum = 0.0;
        for (uint i = 0; i < p.column_taps; ++i) {
            uint from_x = (first_x + i) % p.level_width;
            float line = 0.0;
            for (uint j = 0; j < p.row_taps; ++j) {
                float weight = uintBitsToFloat(table[p.row_weights + p.rows + y * p.row_taps + j]);
                line += weight * values[from + (first_y + j) % p.level_height * p.level_width + from_x];
            }
            sum += uintBitsToFloat(table[p.column_weights + p.columns + x * p.column_taps + i]) * line;
        }
        result[to + y * p.columns + x] = sum;
    }
}
