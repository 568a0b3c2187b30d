#version 450
#extension GL_GOOGLE_include_directive : require

// Transforms the columns of windows that are in use forward, in place. All pupils have windows with the same number of
// rows. x is the pair of columns, y the frame and z the pupil.

#define COLUMNS 1u
#include "half.glsl"
#include "fft_lines.glsl"

layout(std430, binding = 0) buffer Window { COMPLEX2 window[]; };
#define PUPILS 2
#include "pupils.glsl"
layout(push_constant) uniform Args {
    // Number of rows, and the first value of the bound range.
    uint rows, window_base;
    uint members[BATCH];
};

// Index of the pair, and the number of pairs in a row.
uint origin, row;

vec4 fetch4(uint way, uint i) { return LOAD2(window[origin + i * row]); }
void put4(uint way, uint i, vec4 z) { window[origin + i * row] = STORE2(z); }
vec2 fetch2(uint way, uint i) { return vec2(0.0); }
void put2(uint way, uint i, vec2 z) {}

void main() {
    n = rows;
    uint pupil = members[gl_WorkGroupID.z];
    // Some windows have fewer columns in use.
    if (2u * gl_WorkGroupID.x * LINES >= pupils[pupil].used) return;
    uint pair = gl_WorkGroupID.x * LINES + gl_LocalInvocationID.x;
    present = 2u * pair < pupils[pupil].used;
    row = pupils[pupil].columns / 2u;
    uint frame = gl_WorkGroupID.y * pupils[pupil].window_stride, column = pupils[pupil].first + 2u * pair;
    // Columns in use wrap around the window.
    if (column >= pupils[pupil].columns) column -= pupils[pupil].columns;
    origin = (pupils[pupil].window - window_base + frame + column) / 2u;
    transform(0u, false);
}
