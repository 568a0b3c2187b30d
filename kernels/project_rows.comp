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
#define ANGLES_ID 20
#include "binary_angle.glsl"
#include "fft_lines.glsl"

layout(std430, binding = 0) readonly buffer Change2 { COMPLEX change2[]; };
layout(std430, binding = 0) readonly buffer Change4 { COMPLEX2 change4[]; };
// The phases that made the field: the same buffer as `phases` where nothing is quantised.
MAY_ALIAS layout(std430, binding = 2) readonly buffer Shown { uint shown[]; };
MAY_ALIAS layout(std430, binding = 3) buffer Phases { uint phases[]; };
layout(std430, binding = 4) buffer Velocity { uint velocity[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    float gain, momentum, bound;
    uint step_count;
    // Columns in use, and rows in all, those of the SLM.
    uint first, used, all;
    // Values from one frame to the next.
    uint change_stride, phases_stride;
};

#include "project.glsl"

// Where the row's first value is, its sub-frame's first phase, and its first pixel there.
uint origin, base, to;

vec4 fetch4(uint way, uint i) { return in_use(i, first, used) ? LOAD2(change4[(origin + i) / 2u]) : vec4(0.0); }
vec2 fetch2(uint way, uint i) { return in_use(i, first, used) ? LOAD(change2[origin + i]) : vec2(0.0); }
void put2(uint way, uint i, vec2 du) {
    // Unsigned: what lies left of the SLM wraps to something large.
    if (i - left < width) move(base, to + (i - left), du);
}
void put4(uint way, uint i, vec4 z) {
    if (i - left < width && i + 1u - left < width) {
        move_both(base, to + (i - left), z);
        return;
    }
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
    base = frame * phases_stride;
    to = y * width;
    transform(0u, true);
}
