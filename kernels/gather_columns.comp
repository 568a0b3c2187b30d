#version 450
#extension GL_GOOGLE_include_directive : require

// Gathers the changes that all pupils request for a column of the spectrum, and transforms it back. It fuses `overlap`,
// `pupil_adjoint` of each pupil, `divide_by_overlap` and the columns of the change's transform. x is the pair of
// columns, y the frame.

// 1 if this dispatch ends with the division and the transform. Otherwise it only adds the requests of this group of
// pupils.
layout(constant_id = 21) const uint LAST = 1;

#define COLUMNS 1u
// Values are gathered before the transform. A loop inside the stages would keep `v` out of registers.
#define FROM_SHARED(way) true
#define TO_SHARED(way) false
#include "half.glsl"
#include "fft_lines.glsl"

layout(std430, binding = 0) buffer Change { COMPLEX2 change[]; };
layout(std430, binding = 2) readonly buffer Windows { COMPLEX windows[]; };
layout(std430, binding = 3) readonly buffer Transfers { vec2 transfers[]; };
layout(std430, binding = 4) readonly buffer Spans { uvec2 spans[]; };
#define PUPILS 5
#include "pupils.glsl"
#ifdef HALF
// Set as by `check_finite` if a stored value is infinite or NaN. The check is here because no later kernel stores the
// values that follow from it.
layout(std430, binding = 6) buffer NotFinite { uint found[]; };
bool overflows(uvec2 z) {
    return any(equal(z & 0x7c00u, uvec2(0x7c00u))) || any(equal(z & 0x7c000000u, uvec2(0x7c000000u)));
}
#endif
layout(push_constant) uniform Args {
    uint grid_height, grid_width;
    // First column in use, which wraps, and the number of columns in use.
    uint first, used;
    // Number of all pupils, and the range of this group.
    uint count, begin, end;
    // 1 if earlier groups have stored sums.
    uint adds;
    float power;
    uint change_stride, frame;
};

uint column;
// Bits of the pupils that have one of the columns, 32 pupils per component.
uvec2 touched;

uint place2(uint y) { return (gl_WorkGroupID.y * change_stride + y * grid_width + column) / 2u; }

uint from(uint start, uint at, uint size) { return at >= start ? at - start : at + size - start; }

vec2 returned(Pupil p, uint at) {
    vec2 v = LOAD(windows[p.window + (frame + gl_WorkGroupID.y) * p.window_stride + at]) * p.back_scale,
         t = transfers[p.transfer + at];
    return vec2(v.x * t.x + v.y * t.y, v.y * t.x - v.x * t.y);
}

float share(float hits) {
    if (hits <= 1.0) return 1.0;
    return power == 1.0 ? 1.0 / hits : power == 0.5 ? 1.0 / sqrt(hits) : pow(hits, -power);
}

vec4 gathered(uint y) {
    vec4 sum = adds == 1u ? LOAD2(change[place2(y)]) : vec4(0.0);
    vec2 hits = vec2(0.0);
    for (uvec2 rest = touched; any(notEqual(rest, uvec2(0u)));) {
        uint i;
        if (rest.x != 0u) {
            i = uint(findLSB(rest.x));
            rest.x &= rest.x - 1u;
        } else {
            i = 32u + uint(findLSB(rest.y));
            rest.y &= rest.y - 1u;
        }
        Pupil p = pupils[i];
        uint j = from(p.y0, y, grid_height);
        if (j >= p.rows) continue;
        uvec2 span = spans[p.spans + j];
        uint k = from(p.x0, column, grid_width), l = from(p.x0, column + 1u, grid_width);
        bool here = i >= begin && i < end;
        if (k >= span.x && k < span.y) {
            hits.x += 1.0;
            if (here) sum.xy += returned(p, j * p.columns + k);
        }
        if (l >= span.x && l < span.y) {
            hits.y += 1.0;
            if (here) sum.zw += returned(p, j * p.columns + l);
        }
    }
    return LAST == 1u ? sum * vec2(share(hits.x), share(hits.y)).xxyy : sum;
}

vec4 fetch4(uint way, uint y) { return shared4[slot(y)]; }
void put4(uint way, uint y, vec4 z) {
    COMPLEX2 stored = STORE2(z);
    change[place2(y)] = stored;
#ifdef HALF
    if (overflows(stored)) atomicOr(found[0], 1u);
#endif
}
vec2 fetch2(uint way, uint i) { return vec2(0.0); }
void put2(uint way, uint i, vec2 z) {}

void main() {
    n = grid_height;
    uint pair = gl_WorkGroupID.x * LINES + gl_LocalInvocationID.x;
    present = 2u * pair < used;
    column = first + 2u * pair;
    if (column >= grid_width) column -= grid_width;
    touched = uvec2(0u);
    for (uint i = 0u; i < count; i++) {
        Pupil p = pupils[i];
        bool one = from(p.x0, column, grid_width) < p.columns || from(p.x0, column + 1u, grid_width) < p.columns;
        if (one && i < 32u) touched.x |= 1u << i;
        else if (one) touched.y |= 1u << (i - 32u);
    }
    for (uint y = thread(); present && y < n; y += THREADS) {
        vec4 z = gathered(y);
        if (LAST == 1u) shared4[slot(y)] = z;
        else change[place2(y)] = STORE2(z);
    }
    if (LAST == 1u) {
        barrier();
        transform(0u, true);
    }
}
