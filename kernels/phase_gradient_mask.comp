#version 450
#extension GL_GOOGLE_include_directive : require
#include "half.glsl"
#include "trig.glsl"
#include "drives.glsl"

// wave = Im(sum change conj(mask) conj(amplitude exp(i wave))). The sum is over the mask pixels of each pixel of the
// SLM. x is the column of the SLM, y the row (strided) and z the sub-frame.

layout(local_size_x = WIDTH) in;
// Level, amplitude, real and imaginary part of the rest.
layout(std430, binding = 0) readonly buffer Tables { float tables[]; };
layout(std430, binding = 1) readonly buffer Mask { vec2 mask[]; };
layout(std430, binding = 2) readonly buffer Change { COMPLEX change[]; };
layout(std430, binding = 3) buffer Wave { DRIVES wave[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    uint factor, here;
    vec4 cover;
    // Number of values from one sub-frame to the next.
    uint change_stride, wave_stride;
};

void main() {
    uint x = gl_GlobalInvocationID.x, frame = gl_GlobalInvocationID.z;
    if (x >= width) return;
    for (uint y = gl_WorkGroupID.y; y < height; y += gl_NumWorkGroups.y) {
        vec2 sum = vec2(0.0);
        for (uint down = 0u; down < factor; down++) {
            uint row = y * factor + down, from = frame * change_stride + (top + row) * grid_width + left + x * factor;
            for (uint across = 0u; across < factor; across++) {
                vec2 g = LOAD(change[from + across]);
                vec2 m = here != 0u ? mask[(row * width + x) * factor + across] : vec2(1.0, 0.0);
                sum += cover[down] * cover[across] * vec2(g.x * m.x + g.y * m.y, g.y * m.x - g.x * m.y);
            }
        }
        uint pixel = y * width + x, at = frame * wave_stride + pixel;
        vec2 t = cos_sin(DRIVE_AT(wave, at));
        float tau = tables[height * width + pixel] * (t.x * sum.y - t.y * sum.x);
        PUT_DRIVE(wave, at, tau);
    }
}
