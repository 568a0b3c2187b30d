#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// Computes a level of the views from the finer level, by separable weights, periodic. x is the word of two values, y
// the view.

layout(local_size_x = WIDTH) in;
// Two u16 per word, with the first one in the low bits.
layout(std430, binding = 0) readonly buffer Finer { uint finer[]; };
// For each axis, `first` per output sample, then the bits of `weights`, `taps` per output sample.
layout(std430, binding = 1) readonly buffer Tables { uint table[]; };
layout(std430, binding = 2) writeonly buffer Views { uint views[]; };

layout(push_constant) uniform Args {
    uint in_height, in_width, height, width, row_taps, column_taps, in_stride, stride, rows_at, columns_at;
};

float value(uint at) {
    return float((finer[at >> 1] >> ((at & 1u) << 4)) & 0xffffu);
}

uint averaged(uint from, uint y, uint x) {
    uint first_y = table[rows_at + y], first_x = table[columns_at + x];
    float sum = 0.0;
    for (uint i = 0; i < column_taps; ++i) {
        uint from_x = (first_x + i) % in_width;
        float line = 0.0;
        for (uint j = 0; j < row_taps; ++j) {
            float weight = uintBitsToFloat(table[rows_at + height + y * row_taps + j]);
            line += weight * value(from + (first_y + j) % in_height * in_width + from_x);
        }
        sum += uintBitsToFloat(table[columns_at + width + x * column_taps + i]) * line;
    }
    return min(uint(sum + 0.5), 0xffffu);
}

void main() {
    uint pixels = height * width, from = gl_WorkGroupID.y * in_stride;
    uint step_size = gl_NumWorkGroups.x * WIDTH;
    for (uint word = gl_GlobalInvocationID.x; word < (pixels + 1) / 2; word += step_size) {
        uint pixel = 2 * word;
        uint low = averaged(from, pixel / width, pixel % width);
        uint high = pixel + 1 < pixels ? averaged(from, (pixel + 1) / width, (pixel + 1) % width) : 0;
        views[gl_WorkGroupID.y * (stride / 2) + word] = low | high << 16;
    }
}
