#version 450
#extension GL_GOOGLE_include_directive : require
#include "alias.glsl"
#include "half.glsl"
#include "trig.glsl"

// Applies a step of Adam. x is the column, y the row (strided) and z the frame.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Change { COMPLEX change[]; };
// The phases that made the field. This is the buffer `phases` itself if nothing is quantized.
MAY_ALIAS layout(std430, binding = 1) readonly buffer Shown { float shown[]; };
MAY_ALIAS layout(std430, binding = 2) buffer Phases { float phases[]; };
layout(std430, binding = 3) buffer First { float first_moment[]; };
layout(std430, binding = 4) buffer Second { float second_moment[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    float rate, beta1, beta2, correct1, correct2, epsilon;
    // Number of values from one frame to the next.
    uint change_stride, phases_stride;
};

#include "adam.glsl"

void main() {
    uint x = gl_GlobalInvocationID.x;
    uint frame = gl_GlobalInvocationID.z;
    if (x >= width) return;
    for (uint y = gl_WorkGroupID.y; y < height; y += gl_NumWorkGroups.y) {
        adam(frame * phases_stride + y * width + x,
             LOAD(change[frame * change_stride + (top + y) * grid_width + left + x]));
    }
}
