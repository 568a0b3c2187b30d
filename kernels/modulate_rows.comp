#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require

// `modulate` and the rows of the field's transform: phases in, of the rows' spectra the columns in use out.

#define COLUMNS 0u
#include "alias.glsl"
#include "constants.glsl"
#include "half.glsl"
#include "trig.glsl"
#define ANGLES_ID 20
#include "binary_angle.glsl"
#include "fft_lines.glsl"

layout(std430, binding = 0) readonly buffer Phases { uint phases[]; };
MAY_ALIAS layout(std430, binding = 2) writeonly buffer Field2 { COMPLEX field2[]; };
MAY_ALIAS layout(std430, binding = 2) writeonly buffer Field4 { COMPLEX2 field4[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    // Columns in use, and rows in all.
    uint first, used, all;
    float scale;
    // Values from one frame to the next.
    uint phases_stride, field_stride;
};

// Where the row's first phase is and its first value; whether it is one of the SLM's.
uint from, origin;
bool lit;

vec2 fetch2(uint way, uint i) {
    // Unsigned: what lies left of the SLM wraps to something large.
    uint at = from + (i - left);
    return lit && i - left < width ? scale * cos_sin(PHASE_AT(phases, at)) : vec2(0.0);
}
vec4 fetch4(uint way, uint i) { return vec4(fetch2(way, i), fetch2(way, i + 1u)); }
void put4(uint way, uint i, vec4 z) {
    if (in_use(i, first, used)) field4[(origin + i) / 2u] = STORE2(z);
}
void put2(uint way, uint i, vec2 z) {
    if (in_use(i, first, used)) field2[origin + i] = STORE(z);
}

void main() {
    n = grid_width;
    area = gl_LocalInvocationID.y;
    uint line = (gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x) * LINES + area;
    present = line < all;
    uint frame = line / grid_height, y = line - frame * grid_height;
    lit = y - top < height;
    from = frame * phases_stride + (y - top) * width;
    origin = frame * field_stride + y * grid_width;
    transform(0u, false);
}
