#version 450
#extension GL_GOOGLE_include_directive : require
#include "half.glsl"
#include "trig.glsl"
#include "drives.glsl"

// field = scale (amplitude exp(i W) + rest) mask on the mask's pixels, zero around them. x is the column of the grid, y
// the row (strided) and z the sub-frame.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Wave { DRIVES wave[]; };
// Level, amplitude, real and imaginary part of the rest.
layout(std430, binding = 1) readonly buffer Tables { float tables[]; };
layout(std430, binding = 2) readonly buffer Mask { vec2 mask[]; };
layout(std430, binding = 3) writeonly buffer Field { COMPLEX field[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    uint factor, here;
    vec4 cover;
    float scale;
    // Number of values from one sub-frame to the next.
    uint wave_stride, field_stride;
};

void main() {
    uint x = gl_GlobalInvocationID.x, frame = gl_GlobalInvocationID.z;
    if (x >= grid_width) return;
    uint pixels = height * width;
    for (uint y = gl_WorkGroupID.y; y < grid_height; y += gl_NumWorkGroups.y) {
        vec2 value = vec2(0.0);
        // The differences are unsigned, so pixels above or left of the mask wrap to large values.
        uint down = y - top, across = x - left;
        if (down < factor * height && across < factor * width) {
            uint row = down / factor, column = across / factor, pixel = row * width + column;
            vec2 rest = vec2(tables[2 * pixels + pixel], tables[3 * pixels + pixel]);
            vec2 lit = scale * (tables[pixels + pixel] * cos_sin(DRIVE_AT(wave, frame * wave_stride + pixel)) + rest);
            vec2 m = here != 0u ? mask[down * factor * width + across] : vec2(1.0, 0.0);
            float part = cover[down - row * factor] * cover[across - column * factor];
            value = part * vec2(lit.x * m.x - lit.y * m.y, lit.x * m.y + lit.y * m.x);
        }
        field[frame * field_stride + y * grid_width + x] = STORE(value);
    }
}
