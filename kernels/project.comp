#version 450
#extension GL_GOOGLE_include_directive : require
#include "alias.glsl"
#include "half.glsl"
#include "trig.glsl"
#define ANGLES_ID 0
#include "binary_angle.glsl"

// Moves each phase by the share of the change that a phase can follow. x is the column, y the row (strided) and z the
// frame.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Change { COMPLEX change[]; };
// The phases that made the field. This is the buffer `phases` itself if nothing is quantized.
MAY_ALIAS layout(std430, binding = 1) readonly buffer Shown { uint shown[]; };
MAY_ALIAS layout(std430, binding = 2) buffer Phases { uint phases[]; };
layout(std430, binding = 3) buffer Velocity { uint velocity[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    float gain, momentum, bound;
    uint step_count;
    // Number of values from one frame to the next.
    uint change_stride, phases_stride;
};

#include "project.glsl"

void main() {
    uint x = gl_GlobalInvocationID.x;
    uint frame = gl_GlobalInvocationID.z;
    if (x >= width) return;
    for (uint y = gl_WorkGroupID.y; y < height; y += gl_NumWorkGroups.y) {
        vec2 du = LOAD(change[frame * change_stride + (top + y) * grid_width + left + x]);
        move(frame * phases_stride, y * width + x, du);
    }
}
