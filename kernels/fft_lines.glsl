// Transforms whole lines, which are rows or pairs of columns. Functions of the including shader fetch each value once
// and put it once. Between the stages values pass through shared memory.
// For rows, a workgroup has THREADS invocations (x) per row and LINES rows (y). With PAIR, an invocation takes
// neighboring butterflies in pairs. This requires that n / radix is even for all stages, and that the first radix is
// even.
// For columns, a workgroup has LINES neighboring pairs of columns (x) and THREADS invocations (y) per pair. PAIR is 1.
//
// A shader may define COLUMNS. It may define AREAS, the number of lines in shared memory, if this is not the number of
// lines of the workgroup. The argument `way` selects one of a shader's transforms. FROM_SHARED(way) is true if the
// shader fetches its values from shared memory, TO_SHARED(way) if it puts them there.

layout(local_size_x_id = 0, local_size_y_id = 1) in;
layout(constant_id = 0) const uint X = 64;
layout(constant_id = 1) const uint Y = 1;
layout(constant_id = 2) const uint PAIR = 1;
layout(constant_id = 3) const uint STAGES = 3;
// Slots of a row or of a pair of columns in shared memory, with the free slots.
layout(constant_id = 4) const uint SLOTS = 1089;
// Stage i has the radix A B. Each invocation takes up to C of its butterflies (or pairs).
layout(constant_id = 5) const uint A0 = 4;
layout(constant_id = 6) const uint B0 = 4;
layout(constant_id = 7) const uint C0 = 1;
layout(constant_id = 8) const uint A1 = 4;
layout(constant_id = 9) const uint B1 = 4;
layout(constant_id = 10) const uint C1 = 1;
layout(constant_id = 11) const uint A2 = 8;
layout(constant_id = 12) const uint B2 = 1;
layout(constant_id = 13) const uint C2 = 2;
layout(constant_id = 14) const uint A3 = 1;
layout(constant_id = 15) const uint B3 = 1;
layout(constant_id = 16) const uint C3 = 0;
layout(constant_id = 17) const uint A4 = 1;
layout(constant_id = 18) const uint B4 = 1;
layout(constant_id = 19) const uint C4 = 0;
#ifndef COLUMNS
layout(constant_id = 20) const uint COLUMNS = 0;
#endif
const uint THREADS = COLUMNS == 1u ? Y : X;
const uint LINES = COLUMNS == 1u ? X : Y;
#ifndef AREAS
#define AREAS LINES
#endif
#ifndef FROM_SHARED
#define FROM_SHARED(way) false
#define TO_SHARED(way) false
#endif
// Butterflies of a line that an invocation computes side by side.
const uint BESIDE = COLUMNS == 1u ? 1u : 1u + PAIR;

#include "fft_butterfly.glsl"

// Twiddles as in fft_pass.comp, one stage after the other.
layout(std430, binding = 1) readonly buffer Twiddles { vec4 twiddles[]; };

shared vec4 shared4[PAIR == 1u ? AREAS * SLOTS : 1u];
shared vec2 shared2[PAIR == 1u ? 1u : AREAS * SLOTS];

// `n` is the number of points of a line, and `area` is the index of a row in shared memory. `present` is true if this
// invocation's line exists.
uint n, area;
bool present;

// Fetch and put value i of a line. With PAIR, they include the next value of a row, or the same value of the next
// column.
vec4 fetch4(uint way, uint i);
vec2 fetch2(uint way, uint i);
void put4(uint way, uint i, vec4 z);
void put2(uint way, uint i, vec2 z);

uint thread() { return COLUMNS == 1u ? gl_LocalInvocationID.y : gl_LocalInvocationID.x; }

// One slot in FFT_FREE_SLOT + 1 is free, so that invocations that write a radix apart use different banks. The slots of
// a row are contiguous. The slots of a pair of columns alternate with the slots of its neighbors.
uint slot(uint i) {
    uint at = i + i / FFT_FREE_SLOT;
    return COLUMNS == 1u ? at * LINES + gl_LocalInvocationID.x : area * SLOTS + at;
}

// Returns the index of the pair in shared memory that contains value i.
uint unit(uint i) { return COLUMNS == 1u ? i : i / 2u; }

void swap_parts(uint at, uint count) {
    [[unroll]] for (uint k = 0u; k < count; k++) v[at + k] = v[at + k].yxwz;
}

// `s` is the product of the earlier radices, and `table` is the start of this stage's table.
void stage(uint way, bool inverse, uint a, uint b, uint c, uint s, uint table, bool begin, bool end) {
    uint r = a * b, m = n / r;
    bool reads = !begin || FROM_SHARED(way), writes = !end || TO_SHARED(way);
    [[unroll]] for (uint i = 0u; i < c; i++) {
        uint j = (thread() + i * THREADS) * BESIDE, at = i * r;
        if (j < m) {
            if (begin) {
                if (present) {
                    if (PAIR == 1u) {
                        [[unroll]] for (uint k = 0u; k < r; k++) v[at + k] = fetch4(way, j + k * m);
                    } else {
                        [[unroll]] for (uint k = 0u; k < r; k++) v[at + k] = fetch2(way, j + k * m).xyxy;
                    }
                }
                if (inverse) swap_parts(at, r);
            } else {
                if (PAIR == 1u) {
                    [[unroll]] for (uint k = 0u; k < r; k++) v[at + k] = shared4[slot(unit(j + k * m))];
                } else {
                    [[unroll]] for (uint k = 0u; k < r; k++) v[at + k] = shared2[slot(j + k * m)].xyxy;
                }
                uint rest = j % s;
                vec4 w = twiddles[table + rest], next = w;
                if (BESIDE == 2u) next = twiddles[table + rest + 1u];
                twist(at, r, vec4(w.xy, next.xy), vec4(w.zw, next.zw));
            }
        }
        butterfly(a, b, at);
    }
    // All invocations must read before one writes.
    if (reads && writes) barrier();
    [[unroll]] for (uint i = 0u; i < c; i++) {
        uint j = (thread() + i * THREADS) * BESIDE, at = i * r;
        uint to = j / s * s * r + j % s;
        if (j < m) {
            if (end) {
                if (inverse) swap_parts(at, r);
                if (present) {
                    [[unroll]] for (uint k = 0u; k < r; k++) {
                        if (PAIR == 1u) put4(way, to + k * s, v[at + place(k, a, b)]);
                        else put2(way, to + k * s, v[at + place(k, a, b)].xy);
                    }
                }
            } else if (PAIR == 0u) {
                [[unroll]] for (uint k = 0u; k < r; k++) shared2[slot(to + k * s)] = v[at + place(k, a, b)].xy;
            } else if (begin && COLUMNS == 0u) {
                [[unroll]] for (uint k = 0u; k < r; k += 2u) {
                    vec4 p = v[at + place(k, a, b)], q = v[at + place(k + 1u, a, b)];
                    shared4[slot((to + k) / 2u)] = vec4(p.xy, q.xy);
                    shared4[slot((to + r + k) / 2u)] = vec4(p.zw, q.zw);
                }
            } else {
                [[unroll]] for (uint k = 0u; k < r; k++) shared4[slot(unit(to + k * s))] = v[at + place(k, a, b)];
            }
        }
    }
    if (writes) barrier();
}

// Transforms a whole line. The inverse is the forward transform with re and im swapped.
void transform(uint way, bool inverse) {
    const uint S1 = A0 * B0, S2 = S1 * A1 * B1, S3 = S2 * A2 * B2, S4 = S3 * A3 * B3;
    stage(way, inverse, A0, B0, C0, 1u, 0u, true, STAGES == 1u);
    if (STAGES > 1u) stage(way, inverse, A1, B1, C1, S1, 0u, false, STAGES == 2u);
    if (STAGES > 2u) stage(way, inverse, A2, B2, C2, S2, S1, false, STAGES == 3u);
    if (STAGES > 3u) stage(way, inverse, A3, B3, C3, S3, S1 + S2, false, STAGES == 4u);
    if (STAGES > 4u) stage(way, inverse, A4, B4, C4, S4, S1 + S2 + S3, false, true);
}

// Returns true if column i is one of `count` columns from `first` on, of n that wrap.
bool in_use(uint i, uint first, uint count) { return (i >= first ? i - first : i + n - first) < count; }
