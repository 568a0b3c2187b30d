#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require

// One pass of a Stockham transform along columns or rows of frames in global memory: each invocation transforms A * B * C
// values that stand n / (A B C) apart. Columns: x is the column, y the butterfly. Rows: x is the butterfly, y the row.
// z: frame.

layout(local_size_x_id = 4, local_size_y = 1) in;
layout(constant_id = 0) const uint A = 4;
layout(constant_id = 1) const uint B = 4;
layout(constant_id = 2) const uint C = 1;
layout(constant_id = 3) const bool ROWS = false;

layout(std430, binding = 0) readonly buffer From { vec2 from[]; };
layout(std430, binding = 1) writeonly buffer To { vec2 to[]; };
// exp(-i 2 pi k / n).
layout(std430, binding = 2) readonly buffer Roots { vec2 roots[]; };
layout(push_constant) uniform Args {
    // Length, how much of it earlier passes did, and n / (done A B C).
    uint n, done, step;
    // Columns or rows, and whether re and im swap places: that makes it the inverse.
    uint lines, inverse;
    // First column, columns before wrapping, values from row to row and from frame to frame.
    uint from_first, from_wrap, from_row, from_frame;
    uint to_first, to_wrap, to_row, to_frame;
};

const uint RADIX = A * B * C;
vec2 v[RADIX];

#define FIRST 5
#define COSINE(k) cosine_##k
#define SINE(k) sine_##k
#define WAVES waves
#define LOAD_WAVES load_waves
#include "fft_roots.glsl"
#include "fft_lines.glsl"
#define ROOT root
#define TURN turn
#define PRIME_A prime_a
#define PRIME_B prime_b
#define PRIME_C prime_c
#define PLACE place
#define BUTTERFLY butterfly
#include "fft_butterfly.glsl"

void transform(uint line, uint t) {
    uint column = line + from_first;
    if (column >= from_wrap) column -= from_wrap;
    uint at = gl_WorkGroupID.z * from_frame + (ROWS ? line * from_row + t : t * from_row + column);
    uint by = n / RADIX * (ROWS ? 1 : from_row);
    [[unroll]] for (uint i = 0; i < RADIX; ++i) {
        vec2 x = from[at + i * by];
        v[i] = inverse != 0 ? x.yx : x;
    }
    uint k = t % done;
    twist(RADIX, k * step);
    butterfly();
    column = line + to_first;
    if (column >= to_wrap) column -= to_wrap;
    uint out_t = (t - k) * RADIX + k;
    at = gl_WorkGroupID.z * to_frame + (ROWS ? line * to_row + out_t : out_t * to_row + column);
    by = done * (ROWS ? 1 : to_row);
    [[unroll]] for (uint i = 0; i < RADIX; ++i) {
        vec2 x = v[place(i)];
        to[at + i * by] = inverse != 0 ? x.yx : x;
    }
}

void main() {
    uint x = gl_GlobalInvocationID.x;
    load_waves();
    if (ROWS) {
        if (x >= n / RADIX) return;
        for (uint y = gl_WorkGroupID.y; y < lines; y += gl_NumWorkGroups.y) transform(y, x);
    } else {
        if (x >= lines) return;
        for (uint y = gl_WorkGroupID.y; y < n / RADIX; y += gl_NumWorkGroups.y) transform(x, y);
    }
}
