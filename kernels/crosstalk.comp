#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "half.glsl"
#include "drives.glsl"

// Applies the crosstalk between pixels along one axis, or its transpose. Along rows and then along columns, the plane
// of a sub-frame becomes the planes of its sub-pixels. The transpose goes back. x is the column, y the row (strided)
// and z the sub-frame.

layout(local_size_x = WIDTH) in;
// Weights along y, then along x. Each sub-pixel has weights from the pixel `reach` before it to the pixel `reach` after
// it.
layout(std430, binding = 0) readonly buffer Crosstalk { float weights[]; };
layout(std430, binding = 1) readonly buffer From { DRIVES from[]; };
layout(std430, binding = 2) DRIVES_OUT buffer To { DRIVES to[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    uint subpixels, reach_y, reach_x;
    // If `columns` is not 0, the axis is along columns, otherwise along rows. If `back` is not 0, this is the
    // transpose.
    uint columns, back;
    // Number of values from one plane to the next.
    uint from_stride, to_stride;
};

// Returns the contribution of one plane to (y, x) with the weights of one sub-pixel.
float summed(uint plane, uint subpixel, uint y, uint x) {
    bool down = columns != 0;
    uint reach = down ? reach_y : reach_x;
    uint first = down ? top : left, count = down ? height : width, whole = down ? grid_height : grid_width;
    uint start = (down ? 0 : subpixels * (2 * reach_y + 1)) + subpixel * (2 * reach + 1);
    uint origin = plane * from_stride + (down ? x : y * width), stride = down ? width : 1;
    // The index wraps around the grid. It is below 3 `whole`, because the reach is at most half the grid.
    uint at = (down ? y : x) + first + whole - reach;
    float sum = 0.0;
    for (uint j = 0; j <= 2 * reach; j++) {
        uint g = at + j;
        g -= g >= 2 * whole ? 2 * whole : g >= whole ? whole : 0;
        uint place = g - first;
        if (place < count)
            sum += weights[start + (back != 0 ? 2 * reach - j : j)] * DRIVE_AT(from, origin + place * stride);
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
