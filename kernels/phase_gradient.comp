#version 450
#extension GL_GOOGLE_include_directive : require
#include "half.glsl"
#include "trig.glsl"
#include "drives.glsl"

// wave = Im(change conj(amplitude exp(i wave))) on the SLM. x is the column, y the row (strided) and z the sub-frame,
// or one of its sub-pixels.

layout(local_size_x = WIDTH) in;
// Level, amplitude, real and imaginary part of the rest.
layout(std430, binding = 0) readonly buffer Tables { float tables[]; };
layout(std430, binding = 1) readonly buffer Change { COMPLEX change[]; };
layout(std430, binding = 2) buffer Wave { DRIVES wave[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    // Number of values from one plane to the next.
    uint change_stride, wave_stride;
};

void main() {
    uint x = gl_GlobalInvocationID.x, plane = gl_GlobalInvocationID.z;
    if (x >= width) return;
    for (uint y = gl_WorkGroupID.y; y < height; y += gl_NumWorkGroups.y) {
        uint pixel = y * width + x, at = plane * wave_stride + pixel;
        vec2 t = cos_sin(DRIVE_AT(wave, at)),
             g = LOAD(change[plane * change_stride + (y + top) * grid_width + x + left]);
        float tau = tables[height * width + pixel] * (t.x * g.y - t.y * g.x);
        PUT_DRIVE(wave, at, tau);
    }
}
