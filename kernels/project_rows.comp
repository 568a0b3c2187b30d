#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require

// The rows of the change's inverse transform and `project`: columns in use in, phases and velocity out. The change of the
// field is stored nowhere.

#define COLUMNS 0u
#include "alias.glsl"
#include "constants.glsl"
#include "half.glsl"
#include "trig.glsl"
#include "fft_lines.glsl"

layout(std430, binding = 0) readonly buffer Change2 { COMPLEX change2[]; };
layout(std430, binding = 0) readonly buffer Change4 { COMPLEX2 change4[]; };
// The phases that made the field: the same buffer as `phases` where nothing is quantised.
MAY_ALIAS layout(std430, binding = 2) readonly buffer Shown { float shown[]; };
MAY_ALIAS layout(std430, binding = 3) buffer Phases { float phases[]; };
layout(std430, binding = 4) buffer Velocity { float velocity[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    float gain, momentum, bound;
    // Columns in use, and rows in all, those of the SLM.
    uint first, used, all;
    // Values from one frame to the next.
    uint change_stride, phases_stride;
};

// Where the row's first value is, and its first phase.
uint origin, to;

vec4 fetch4(uint way, uint i) { return in_use(i, first, used) ? LOAD2(change4[(origin + i) / 2u]) : vec4(0.0); }
vec2 fetch2(uint way, uint i) { return in_use(i, first, used) ? LOAD(change2[origin + i]) : vec2(0.0); }
void put2(uint way, uint i, vec2 du) {
    // Unsigned: what lies left of the SLM wraps to something large.
    if (i - left >= width) return;
    uint at = to + (i - left);
    float phase = phases[at];
    vec2 u = cos_sin(shown[at]);
    float turn = gain * (u.x * du.y - u.y * du.x);
    float w = momentum * velocity[at] + turn;
    velocity[at] = w;
    phases[at] = turned(phase, momentum * w + turn, bound);
}
void put4(uint way, uint i, vec4 z) {
    put2(way, i, z.xy);
    put2(way, i + 1u, z.zw);
}

void main() {
    n = grid_width;
    area = gl_LocalInvocationID.y;
    uint line = (gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x) * LINES + area;
    present = line < all;
    uint frame = line / height, y = line - frame * height;
    origin = frame * change_stride + (top + y) * grid_width;
    to = frame * phases_stride + y * width;
    transform(0u, true);
}
