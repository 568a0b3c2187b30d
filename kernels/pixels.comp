#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// Unpacks a video frame for a display. A pixel is (r, g, b, 255), or (b, g, r, 255), and gray has r = g = b. x is the
// column (64 invocations), y the row (strided).

layout(local_size_x = WIDTH) in;
// Rows of `row` bytes, a multiple of 4.
layout(std430, binding = 0) readonly buffer Frame { uint frame[]; };
layout(std430, binding = 1) writeonly buffer Pixels { uint pixels[]; };

layout(push_constant) uniform Args {
    uint height, width, row, channels, blue_first;
};

uint byte_at(uint i) {
    return (frame[i >> 2] >> (8 * (i & 3))) & 255u;
}

void main() {
    uint x = gl_GlobalInvocationID.x;
    if (x >= width) return;
    for (uint y = gl_WorkGroupID.y; y < height; y += gl_NumWorkGroups.y) {
        uint at = y * row + x * channels;
        uint r = byte_at(at);
        uint g = channels == 1 ? r : byte_at(at + 1);
        uint b = channels == 1 ? r : byte_at(at + 2);
        pixels[y * width + x] = (blue_first != 0 ? b | g << 8 | r << 16 : r | g << 8 | b << 16) | 0xff000000u;
    }
}
