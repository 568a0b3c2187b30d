#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// target = separable weights over the accumulator, periodic. x: column, y: row (strided).

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Input { float values[]; };
// A table: `first` per output sample, then the bits of `weights`, `taps` per output sample.
layout(std430, binding = 1) readonly buffer Rows { uint row_table[]; };
layout(std430, binding = 2) readonly buffer Columns { uint column_table[]; };
layout(std430, binding = 3) writeonly buffer Output { float result[]; };
layout(push_constant) uniform Args {
    uint in_height, in_width, height, width, row_taps, column_taps;
};

void main() {
    uint x = gl_GlobalInvocationID.x;
    if (x >= width) return;
    uint first_x = column_table[x];
    for (uint y = gl_WorkGroupID.y; y < height; y += gl_NumWorkGroups.y) {
        uint first_y = row_table[y];
        float sum = 0.0;
        for (uint i = 0; i < column_taps; ++i) {
            uint from_x = (first_x + i) % in_width;
            float line = 0.0;
            for (uint j = 0; j < row_taps; ++j) {
                float weight = uintBitsToFloat(row_table[height + y * row_taps + j]);
                line += weight * values[(first_y + j) % in_height * in_width + from_x];
            }
            sum += uintBitsToFloat(column_table[width + x * column_taps + i]) * line;
        }
        result[y * width + x] = sum;
    }
}
