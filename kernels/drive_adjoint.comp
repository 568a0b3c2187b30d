#version 450
#extension GL_GOOGLE_include_directive : require
#include "half.glsl"
#include "trig.glsl"
#define ANGLES_ID 0
#include "binary_angle.glsl"
#include "drives.glsl"

// Carries the gradient back through the look-up table. The result is the change of a field of the phases themselves. x
// is the column, y the row (strided) and z the sub-frame.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Tables { float level[]; };
layout(std430, binding = 1) readonly buffer Shown { uint shown[]; };
layout(std430, binding = 2) readonly buffer Wave { DRIVES wave[]; };
layout(std430, binding = 3) buffer Change { COMPLEX change[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    float bend_sin, bend_cos, lag;
    // Sub-pixels along an axis, and the number of values from one frame, or sub-pixel, to the next.
    uint subpixels, shown_stride, wave_stride, change_stride;
};

void main() {
    uint x = gl_GlobalInvocationID.x, frame = gl_GlobalInvocationID.z;
    if (x >= width) return;
    for (uint y = gl_WorkGroupID.y; y < height; y += gl_NumWorkGroups.y) {
        uint pixel = y * width + x;
        float tau = DRIVE_AT(wave, frame * subpixels * subpixels * wave_stride + pixel);
        vec2 t = cos_sin(wrapped(PHASE_AT(shown, frame * shown_stride + pixel)));
        float turn = (level[pixel] + (bend_sin * t.x + bend_cos * t.y)) * tau;
        change[frame * change_stride + (y + top) * grid_width + x + left] = STORE(vec2(-turn * t.y, turn * t.x));
    }
}
