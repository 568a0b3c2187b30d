#version 450
#extension GL_GOOGLE_include_directive : require
#include "half.glsl"
#include "trig.glsl"
#define ANGLES_ID 0
#include "binary_angle.glsl"
#include "drives.glsl"

// Turns phases into the phases that their drives give. x is the column, y the row (strided) and z the sub-frame.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Shown { uint shown[]; };
layout(std430, binding = 1) readonly buffer Tables { float level[]; };
layout(std430, binding = 2) DRIVES_OUT buffer Wave { DRIVES wave[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    float bend_sin, bend_cos, lag;
    // Sub-pixels along an axis, and the number of values from one frame, or sub-pixel, to the next.
    uint subpixels, shown_stride, wave_stride;
};

#include "driven.glsl"

void main() {
    uint x = gl_GlobalInvocationID.x, frame = gl_GlobalInvocationID.z;
    if (x >= width) return;
    for (uint y = gl_WorkGroupID.y; y < height; y += gl_NumWorkGroups.y) {
        uint at = y * width + x;
        float phase = PHASE_AT(shown, frame * shown_stride + at);
        PUT_DRIVE(wave, frame * subpixels * subpixels * wave_stride + at, driven(phase, level[at]));
    }
}
