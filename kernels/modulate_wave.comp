#version 450
#extension GL_GOOGLE_include_directive : require
#include "half.glsl"
#include "trig.glsl"
#include "drives.glsl"

// field = scale (amplitude exp(i W) + rest) on the SLM, zero around it. x is the column, y the row (strided) and z the
// sub-frame, or one of its sub-pixels.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Wave { DRIVES wave[]; };
// Level, amplitude, real and imaginary part of the rest.
layout(std430, binding = 1) readonly buffer Tables { float tables[]; };
layout(std430, binding = 2) writeonly buffer Field { COMPLEX field[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    float scale;
    // Number of values from one plane to the next.
    uint wave_stride, field_stride;
};

void main() {
    uint x = gl_GlobalInvocationID.x, plane = gl_GlobalInvocationID.z;
    if (x >= grid_width) return;
    uint pixels = height * width;
    for (uint y = gl_WorkGroupID.y; y < grid_height; y += gl_NumWorkGroups.y) {
        vec2 value = vec2(0.0);
        if (y - top < height && x - left < width) {
            uint pixel = (y - top) * width + (x - left);
            vec2 rest = vec2(tables[2 * pixels + pixel], tables[3 * pixels + pixel]);
            value = scale * (tables[pixels + pixel] * cos_sin(DRIVE_AT(wave, plane * wave_stride + pixel)) + rest);
        }
        field[plane * field_stride + y * grid_width + x] = STORE(value);
    }
}
