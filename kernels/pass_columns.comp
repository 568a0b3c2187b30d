#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require

// `pass_pupil` and the columns of the window's inverse transform: of the spectrum the bins that pass in, the window's columns
// in use out. x: pairs of columns, y: frame.

#define COLUMNS 1u
#include "constants.glsl"
#include "half.glsl"
#include "fft_lines.glsl"

layout(std430, binding = 0) readonly buffer Spectrum { COMPLEX spectrum[]; };
layout(std430, binding = 2) readonly buffer Transfer { vec4 transfer[]; };
layout(std430, binding = 3) readonly buffer Spans { uvec2 spans[]; };
layout(std430, binding = 4) writeonly buffer Window { COMPLEX2 window[]; };
layout(push_constant) uniform Args {
    uint grid_height, grid_width, y0, x0, rows, columns;
    float scale;
    // Columns in use.
    uint first, used;
    // Values from one frame to the next.
    uint spectrum_stride, window_stride;
};

// The pair's first column, in the window and in the grid, and the one beside that.
uint column, x, beside;

vec2 passed(uint at, vec2 t) {
    vec2 u = LOAD(spectrum[at]) * scale;
    return vec2(u.x * t.x - u.y * t.y, u.x * t.y + u.y * t.x);
}

vec4 fetch4(uint way, uint j) {
    uvec2 span = spans[j];
    vec4 z = vec4(0.0);
    if (column + 1u < span.x || column >= span.y) return z;
    uint y = y0 + j;
    if (y >= grid_height) y -= grid_height;
    uint row = gl_WorkGroupID.y * spectrum_stride + y * grid_width;
    vec4 t = transfer[(j * columns + column) / 2u];
    if (column >= span.x) z.xy = passed(row + x, t.xy);
    if (column + 1u < span.y) z.zw = passed(row + beside, t.zw);
    return z;
}
void put4(uint way, uint j, vec4 z) {
    window[(gl_WorkGroupID.y * window_stride + j * columns + column) / 2u] = STORE2(z);
}
vec2 fetch2(uint way, uint i) { return vec2(0.0); }
void put2(uint way, uint i, vec2 z) {}

void main() {
    n = rows;
    uint pair = gl_WorkGroupID.x * LINES + gl_LocalInvocationID.x;
    present = 2u * pair < used;
    column = first + 2u * pair;
    x = (x0 + column) % grid_width;
    beside = x + 1u == grid_width ? 0u : x + 1u;
    transform(0u, true);
}
