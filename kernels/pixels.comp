#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// Unpacks a video frame for a display. A pixel is (r, g, b, 255), or (b, g, r, 255), and gray has r = g = b. The frame
// begins at row `top` and column `left` of the picture, and has `rows` and `columns`. Around it is `fill`. x is the
// column (64 invocations), y the row (strided).

layout(local_size_x = WIDTH) in;
// Rows of `row` bytes, a multiple of 4.
layout(std430, binding = 0) readonly buffer Frame { uint frame[]; };
layout(std430, binding = 1) writeonly buffer Pixels { uint pixels[]; };

layout(push_constant) uniform Args {
    uint height, width, row, channels, blue_first, top, left, rows, columns, fill;
};

uint byte_at(uint i) {
    return (frame[i >> 2] >> (8 * (i & 3))) & 255u;
}

void main() {
    uint x = gl_GlobalInvocationID.x;
    if (x >= width) return;
    for (uint y = gl_WorkGroupID.y; y < height; y += gl_NumWorkGroups.y) {
        // Before the frame, the difference wraps to a number beyond it.
        uint yy = y - top, xx = x - left;
        uint r = fill, g = fill, b = fill;
        if (yy < rows && xx < columns) {
            uint at = yy * row + xx * channels;
            r = byte_at(at);
            g = channels == 1 ? r : byte_at(at + 1);
            b = channels == 1 ? r : byte_at(at + 2);
        }
        pixels[y * width + x] = (blue_first != 0 ? b | g << 8 | r << 16 : r | g << 8 | b << 16) | 0xff000000u;
    }
}
