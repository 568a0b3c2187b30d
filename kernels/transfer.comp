#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "trig.glsl"
#include "pair.glsl"

// K(q; p) on a window: exp(i 2 pi turns) inside the spans, zero outside. x: column, y: row (strided).
// The phase runs to thousands of turns: it is computed in pairs of float32 and reduced to a fraction of one turn first.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Spans { uvec2 spans[]; };
layout(std430, binding = 1) writeonly buffer Transfer { vec2 transfer[]; };
layout(push_constant) uniform Args {
    // float64 as (high, low).
    vec2 slope_y, slope_x, turns;
    int y0, x0;
    uint rows, columns;
};

// The square of a bin's number, below 2^16.
vec2 square(int k) {
    uint n = uint(abs(k));
    return pair_of(n * n);
}

void main() {
    uint k = gl_GlobalInvocationID.x;
    if (k >= columns) return;
    vec2 along = pair_multiply(slope_x, square(x0 + int(k)));
    for (uint j = gl_WorkGroupID.y; j < rows; j += gl_NumWorkGroups.y) {
        vec2 value = vec2(0.0);
        uvec2 span = spans[j];
        if (k >= span.x && k < span.y) {
            vec2 a = pair_add(pair_multiply(slope_y, square(y0 + int(j))), along);
            if (a.x >= 1.0) a = vec2(1.0, 0.0);
            // sqrt(1 - a) - 1, without the loss of digits.
            vec2 root = pair_root(pair_add(vec2(1.0, 0.0), -a));
            vec2 t = pair_multiply(turns, pair_divide(a, pair_add(vec2(1.0, 0.0), root)));
            precise float part = t.x - roundEven(t.x);
            part += t.y;
            part -= roundEven(part);
            precise float phase = part * -6.28318531;
            value = cos_sin(phase);
        }
        transfer[j * columns + k] = value;
    }
}
