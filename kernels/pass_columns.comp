#version 450
#extension GL_GOOGLE_include_directive : require

// Fuses `pass_pupil` with the columns of the window's inverse transform. It reads the bins of the spectrum that pass,
// and stores the columns of the window that are in use. All pupils have windows with the same number of rows. x is the
// pair of columns, y the frame and z the pupil.

#define COLUMNS 1u
#include "half.glsl"
#include "fft_lines.glsl"

layout(std430, binding = 0) readonly buffer Spectrum { COMPLEX spectrum[]; };
layout(std430, binding = 2) readonly buffer Transfer { vec4 transfer[]; };
layout(std430, binding = 3) readonly buffer Spans { uvec2 spans[]; };
layout(std430, binding = 4) writeonly buffer Window { COMPLEX2 window[]; };
#define PUPILS 5
#include "pupils.glsl"
layout(push_constant) uniform Args {
    uint grid_height, grid_width, rows;
    // Number of values from one frame to the next, and the first value of each bound range.
    uint spectrum_stride, transfer_base, window_base;
    uint members[BATCH];
};

uint pupil;
// First column of the pair, in the window and in the grid, and the next column in the grid.
uint column, x, beside;
// Start of the window, and of its propagation kernel.
uint to, kernel;

vec2 passed(uint at, vec2 t) {
    vec2 u = LOAD(spectrum[at]) * pupils[pupil].pass_scale;
    return vec2(u.x * t.x - u.y * t.y, u.x * t.y + u.y * t.x);
}

vec4 fetch4(uint way, uint j) {
    uvec2 span = spans[pupils[pupil].spans + j];
    vec4 z = vec4(0.0);
    if (column + 1u < span.x || column >= span.y) return z;
    uint y = pupils[pupil].y0 + j;
    if (y >= grid_height) y -= grid_height;
    uint row = gl_WorkGroupID.y * spectrum_stride + y * grid_width;
    vec4 t = transfer[(kernel + j * pupils[pupil].columns + column) / 2u];
    if (column >= span.x) z.xy = passed(row + x, t.xy);
    if (column + 1u < span.y) z.zw = passed(row + beside, t.zw);
    return z;
}
void put4(uint way, uint j, vec4 z) { window[(to + j * pupils[pupil].columns + column) / 2u] = STORE2(z); }
vec2 fetch2(uint way, uint i) { return vec2(0.0); }
void put2(uint way, uint i, vec2 z) {}

void main() {
    n = rows;
    pupil = members[gl_WorkGroupID.z];
    // Some windows have fewer columns in use.
    if (2u * gl_WorkGroupID.x * LINES >= pupils[pupil].used) return;
    uint pair = gl_WorkGroupID.x * LINES + gl_LocalInvocationID.x;
    present = 2u * pair < pupils[pupil].used;
    column = pupils[pupil].first + 2u * pair;
    x = (pupils[pupil].x0 + column) % grid_width;
    beside = x + 1u == grid_width ? 0u : x + 1u;
    to = pupils[pupil].window - window_base + gl_WorkGroupID.y * pupils[pupil].window_stride;
    kernel = pupils[pupil].transfer - transfer_base;
    transform(0u, true);
}
