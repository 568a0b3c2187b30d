#version 450
#extension GL_GOOGLE_include_directive : require

// One pass of a Stockham transform through global memory. Each invocation transforms A B values that are n / (A B)
// apart. If PAIR is 1, it does so for two neighboring columns (or, in rows, two neighboring butterflies). For columns,
// x is the column and y the butterfly. For rows, x is the butterfly and y the row. z is the frame.

layout(local_size_x_id = 0, local_size_y_id = 1) in;
layout(constant_id = 2) const uint A = 4;
layout(constant_id = 3) const uint B = 4;
layout(constant_id = 4) const uint PAIR = 1;
layout(constant_id = 5) const uint ROWS = 0;
// 1 if this is the first pass, so no value needs a twiddle factor.
layout(constant_id = 6) const uint FIRST = 0;
const uint R = A * B;

#include "alias.glsl"
#include "half.glsl"
#include "fft_butterfly.glsl"

MAY_ALIAS layout(std430, binding = 0) readonly buffer From2 { COMPLEX from2[]; };
MAY_ALIAS layout(std430, binding = 0) readonly buffer From4 { COMPLEX2 from4[]; };
MAY_ALIAS layout(std430, binding = 1) writeonly buffer To2 { COMPLEX to2[]; };
MAY_ALIAS layout(std430, binding = 1) writeonly buffer To4 { COMPLEX2 to4[]; };
// (w, w^power) of exp(-i 2 pi j / (s R)), j < s, from `table` on.
layout(std430, binding = 2) readonly buffer Twiddles { vec4 twiddles[]; };
layout(push_constant) uniform Args {
    // Length, product of the earlier radices, its inverse, and start of the table.
    uint n, s;
    float inverse_s;
    uint table;
    // If `inverse` is 1, re and im swap places, which gives the inverse. `count` is the number of columns or rows.
    uint inverse, count;
    // First column, and the number of columns before they wrap.
    uint first, wrap;
    // Number of values from row to row, and from frame to frame.
    uint row, from_frame, to_frame;
};

void main() {
    uint x = gl_GlobalInvocationID.x * (1u + PAIR), y = gl_GlobalInvocationID.y, frame = gl_GlobalInvocationID.z;
    uint m = n / R;
    if (x >= (ROWS == 1u ? m : count) || y >= (ROWS == 1u ? count : m)) return;
    uint j = ROWS == 1u ? x : y;
    // This is exactly j / s, because the half keeps it farther from integers than the rounding of float32.
    uint block = FIRST == 1u ? j : uint((float(j) + 0.5) * inverse_s);
    uint rest = FIRST == 1u ? 0u : j - block * s;
    uint j_to = block * s * R + rest;
    uint from, to, k_from, k_to;
    if (ROWS == 1u) {
        from = y * row + j;
        to = y * row + j_to;
        k_from = m;
        k_to = s;
    } else {
        uint column = first + x;
        if (column >= wrap) column -= wrap;
        from = column + j * row;
        to = column + j_to * row;
        k_from = m * row;
        k_to = s * row;
    }
    from += frame * from_frame;
    to += frame * to_frame;
    if (PAIR == 1u) {
        [[unroll]] for (uint k = 0u; k < R; k++) v[k] = LOAD2(from4[(from + k * k_from) / 2u]);
    } else {
        [[unroll]] for (uint k = 0u; k < R; k++) v[k] = LOAD(from2[from + k * k_from]).xyxy;
    }
    if (inverse == 1u) {
        [[unroll]] for (uint k = 0u; k < R; k++) v[k] = v[k].yxwz;
    }
    if (FIRST == 0u) {
        vec4 w = twiddles[table + rest], next = w;
        if (ROWS == 1u && PAIR == 1u) next = twiddles[table + rest + 1u];
        twist(0u, R, vec4(w.xy, next.xy), vec4(w.zw, next.zw));
    }
    butterfly(A, B, 0u);
    if (inverse == 1u) {
        [[unroll]] for (uint k = 0u; k < R; k++) v[k] = v[k].yxwz;
    }
    if (PAIR == 0u) {
        [[unroll]] for (uint k = 0u; k < R; k++) to2[to + k * k_to] = STORE(v[place(k, A, B)].xy);
    } else if (ROWS == 1u && FIRST == 1u) {
        // Outputs of one butterfly are neighbors, but outputs of neighboring butterflies are not.
        [[unroll]] for (uint k = 0u; k < R; k += 2u) {
            vec4 a = v[place(k, A, B)], b = v[place(k + 1u, A, B)];
            to4[(to + k) / 2u] = STORE2(vec4(a.xy, b.xy));
            to4[(to + R + k) / 2u] = STORE2(vec4(a.zw, b.zw));
        }
    } else {
        [[unroll]] for (uint k = 0u; k < R; k++) to4[(to + k * k_to) / 2u] = STORE2(v[place(k, A, B)]);
    }
}
