#version 450
#extension GL_GOOGLE_include_directive : require
#include "trig.glsl"
#include "pair.glsl"

// Computes the propagation kernel K on the windows of several pupils. It is exp(i 2 pi turns) inside the spans and zero
// outside. x is the column, y the row (strided) and z the pupil. The phase reaches thousands of turns, so it is
// computed in pairs of float32 and reduced to a fraction of one turn first.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Spans { uvec2 spans[]; };
layout(std430, binding = 1) writeonly buffer Transfer { vec2 transfer[]; };
#define PUPILS 2
#include "pupils.glsl"
layout(push_constant) uniform Args {
    // First value of the bound range.
    uint transfer_base;
    uint members[BATCH];
};

// Returns the square of the number of a bin, below 2^16, moved by a shift.
vec2 square(int k, vec2 shift) {
    uint n = uint(abs(k));
    if (shift.x == 0.0) return pair_of(n * n);
    vec2 at = pair_add(vec2(float(k), 0.0), shift);
    return pair_multiply(at, at);
}

void main() {
    Pupil p = pupils[members[gl_WorkGroupID.z]];
    uint k = gl_GlobalInvocationID.x;
    if (k >= p.columns) return;
    vec2 slope_y = vec2(p.slope_y, p.slope_y_low), turns = vec2(p.turns, p.turns_low);
    vec2 shift_y = vec2(p.shift_y, p.shift_y_low), shift_x = vec2(p.shift_x, p.shift_x_low);
    vec2 along = pair_multiply(vec2(p.slope_x, p.slope_x_low), square(p.bin_x + int(k), shift_x));
    for (uint j = gl_WorkGroupID.y; j < p.rows; j += gl_NumWorkGroups.y) {
        vec2 value = vec2(0.0);
        uvec2 span = spans[p.spans + j];
        if (k >= span.x && k < span.y) {
            vec2 a = pair_add(pair_multiply(slope_y, square(p.bin_y + int(j), shift_y)), along);
            if (a.x >= 1.0) a = vec2(1.0, 0.0);
            // This form of sqrt(1 - a) - 1 loses no digits.
            vec2 root = pair_root(pair_add(vec2(1.0, 0.0), -a));
            vec2 t = pair_multiply(turns, pair_divide(a, pair_add(vec2(1.0, 0.0), root)));
            precise float part = t.x - roundEven(t.x);
            part += t.y;
            part -= roundEven(part);
            precise float phase = part * -6.28318531;
            value = cos_sin(phase);
        }
        transfer[p.transfer - transfer_base + j * p.columns + k] = value;
    }
}
