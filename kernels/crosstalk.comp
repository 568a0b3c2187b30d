#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "half.glsl"
#include "drives.glsl"

// Crosstalk between pixels along one axis, or transposed: from a plane of each sub-frame to those of its sub-pixels, or back.
// x: column, y: row (strided), z: sub-frame.

layout(local_size_x = WIDTH) in;
// Along y, then along x: of each sub-pixel from the pixel `reach` before it to that behind it.
layout(std430, binding = 0) readonly buffer Crosstalk { float weights[]; };
layout(std430, binding = 1) readonly buffer From { DRIVES from[]; };
layout(std430, binding = 2) DRIVES_OUT buffer To { DRIVES to[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    uint subpixels, reach_y, reach_x;
    // Along columns, not rows; transposed.
    uint columns, back;
    // Values from one plane to the next.
    uint from_stride, to_stride;
};

// What one plane adds to (y, x) by one sub-pixel's weights.
float summed(uint plane, uint subpixel, uint y, uint x) {
    bool down = columns != 0;
    uint reach = down ? reach_y : reach_x;
    uint first = down ? top : left, count = down ? height : width, whole = down ? grid_height : grid_width;
    uint start = (down ? 0 : subpixels * (2 * reach_y + 1)) + subpixel * (2 * reach + 1);
    uint origin = plane * from_stride + (down ? x : y * width), stride = down ? width : 1;
    // Around the grid: at most half of it is reached.
    uint at = (down ? y : x) + first + whole - reach;
    float sum = 0.0;
    for (uint j = 0; j <= 2 * reach; j++) {
        uint g = at + j;
        g -= g >= 2 * whole ? 2 * whole : g >= whole ? whole : 0;
        uint place = g - first;
        if (place < count) sum += weights[start + (back != 0 ? 2 * reach - j : j)] * DRIVE_AT(from, origin + place * stride);
    }
    return sum;
}

void main() {
    uint x = gl_GlobalInvocationID.x, frame = gl_GlobalInvocationID.z, p = subpixels;
    if (x >= width) return;
    for (uint y = gl_WorkGroupID.y; y < height; y += gl_NumWorkGroups.y) {
        uint at = y * width + x;
        if (columns == 0 && back != 0) {
            float sum = 0.0;
            for (uint b = 0; b < p; b++) sum += summed(frame * p + b, b, y, x);
            PUT_DRIVE(to, frame * p * p * to_stride + at, sum);
            continue;
        }
        for (uint b = 0; b < p; b++) {
            if (columns == 0) {
                float sum = summed(frame * p * p, b, y, x);
                PUT_DRIVE(to, (frame * p + b) * to_stride + at, sum);
            } else if (back == 0) {
                for (uint a = 0; a < p; a++) {
                    float sum = summed(frame * p + b, a, y, x);
                    PUT_DRIVE(to, ((frame * p + a) * p + b) * to_stride + at, sum);
                }
            } else {
                float sum = 0.0;
                for (uint a = 0; a < p; a++) sum += summed((frame * p + a) * p + b, a, y, x);
                PUT_DRIVE(to, (frame * p + b) * to_stride + at, sum);
            }
        }
    }
}
