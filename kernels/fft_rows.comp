#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require

// Whole rows through shared memory: each is read once and written once, in place. An invocation transforms as many
// values as the radix of the stage; between stages the workgroup exchanges them. x: place in the row and, with y, which
// row of the workgroup; groups: rows by x and y, frames by z. Up to three stages; a radix of 1 is no stage.

layout(local_size_x_id = 0, local_size_y_id = 1) in;
layout(constant_id = 0) const uint THREADS = 1;
layout(constant_id = 1) const uint LINES = 1;
layout(constant_id = 2) const uint A1 = 1;
layout(constant_id = 3) const uint B1 = 1;
layout(constant_id = 4) const uint C1 = 1;
layout(constant_id = 5) const uint A2 = 1;
layout(constant_id = 6) const uint B2 = 1;
layout(constant_id = 7) const uint C2 = 1;
layout(constant_id = 8) const uint A3 = 1;
layout(constant_id = 9) const uint B3 = 1;
layout(constant_id = 10) const uint C3 = 1;

layout(std430, binding = 0) buffer Data { vec2 data[]; };
// exp(-i 2 pi k / n).
layout(std430, binding = 1) readonly buffer Roots { vec2 roots[]; };
layout(push_constant) uniform Args {
    // Rows, whether re and im swap places (that makes it the inverse), values from row to row and from frame to frame.
    uint rows, inverse, row, frame;
};

const uint R1 = A1 * B1 * C1;
const uint R2 = A2 * B2 * C2;
const uint R3 = A3 * B3 * C3;
const uint N = R1 * R2 * R3;
const uint R12 = R1 > R2 ? R1 : R2;
const uint MOST = R12 > R3 ? R12 : R3;
vec2 v[MOST];
shared vec2 line[R2 > 1 ? LINES * N : 1];

#include "fft_lines.glsl"

#define FIRST 11
#define A A1
#define B B1
#define C C1
#define COSINE(k) cosine1_##k
#define SINE(k) sine1_##k
#define WAVES waves1
#define LOAD_WAVES load_waves1
#define ROOT root1
#define TURN turn1
#define PRIME_A prime1_a
#define PRIME_B prime1_b
#define PRIME_C prime1_c
#define PLACE place1
#define BUTTERFLY butterfly1
#include "fft_roots.glsl"
#include "fft_butterfly.glsl"
#undef FIRST
#undef A
#undef B
#undef C
#undef COSINE
#undef SINE
#undef WAVES
#undef LOAD_WAVES
#undef ROOT
#undef TURN
#undef PRIME_A
#undef PRIME_B
#undef PRIME_C
#undef PLACE
#undef BUTTERFLY

#define FIRST 75
#define A A2
#define B B2
#define C C2
#define COSINE(k) cosine2_##k
#define SINE(k) sine2_##k
#define WAVES waves2
#define LOAD_WAVES load_waves2
#define ROOT root2
#define TURN turn2
#define PRIME_A prime2_a
#define PRIME_B prime2_b
#define PRIME_C prime2_c
#define PLACE place2
#define BUTTERFLY butterfly2
#include "fft_roots.glsl"
#include "fft_butterfly.glsl"
#undef FIRST
#undef A
#undef B
#undef C
#undef COSINE
#undef SINE
#undef WAVES
#undef LOAD_WAVES
#undef ROOT
#undef TURN
#undef PRIME_A
#undef PRIME_B
#undef PRIME_C
#undef PLACE
#undef BUTTERFLY

#define FIRST 139
#define A A3
#define B B3
#define C C3
#define COSINE(k) cosine3_##k
#define SINE(k) sine3_##k
#define WAVES waves3
#define LOAD_WAVES load_waves3
#define ROOT root3
#define TURN turn3
#define PRIME_A prime3_a
#define PRIME_B prime3_b
#define PRIME_C prime3_c
#define PLACE place3
#define BUTTERFLY butterfly3
#include "fft_roots.glsl"
#include "fft_butterfly.glsl"

void main() {
    load_waves1();
    load_waves2();
    load_waves3();
    uint t = gl_LocalInvocationID.x, own = gl_LocalInvocationID.y * N;
    uint y = (gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x) * LINES + gl_LocalInvocationID.y;
    uint at = gl_WorkGroupID.z * frame + y * row;
    bool live = y < rows, swap = inverse != 0;

    bool works = t < N / R1;
    if (live && works) {
        [[unroll]] for (uint i = 0; i < R1; ++i) {
            vec2 x = data[at + t + i * (N / R1)];
            v[i] = swap ? x.yx : x;
        }
        butterfly1();
        if (R2 == 1) {
            [[unroll]] for (uint i = 0; i < R1; ++i) {
                vec2 x = v[place1(i)];
                data[at + i] = swap ? x.yx : x;
            }
        } else {
            [[unroll]] for (uint i = 0; i < R1; ++i) line[own + t * R1 + i] = v[place1(i)];
        }
    }
    if (R2 == 1) return;
    barrier();

    works = t < N / R2;
    uint k = t % R1, out_t = (t - k) * R2 + k;
    if (works) {
        [[unroll]] for (uint i = 0; i < R2; ++i) v[i] = line[own + t + i * (N / R2)];
        twist(R2, k * (N / (R1 * R2)));
        butterfly2();
        if (R3 == 1) {
            if (live) {
                [[unroll]] for (uint i = 0; i < R2; ++i) {
                    vec2 x = v[place2(i)];
                    data[at + k + i * R1] = swap ? x.yx : x;
                }
            }
        }
    }
    if (R3 == 1) return;
    barrier();
    if (works) {
        [[unroll]] for (uint i = 0; i < R2; ++i) line[own + out_t + i * R1] = v[place2(i)];
    }
    barrier();

    if (live && t < N / R3) {
        [[unroll]] for (uint i = 0; i < R3; ++i) v[i] = line[own + t + i * (N / R3)];
        twist(R3, t);
        butterfly3();
        [[unroll]] for (uint i = 0; i < R3; ++i) {
            vec2 x = v[place3(i)];
            data[at + t + i * (N / R3)] = swap ? x.yx : x;
        }
    }
}
