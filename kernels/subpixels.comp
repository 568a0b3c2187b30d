#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "half.glsl"

// Combines planes of sub-pixels into the spectrum of the field, between the transforms. One dispatch adds the planes of
// a row of sub-pixels to the first of them, and another adds these to the field. Their transposes go back. x is the
// column, y the row (strided) and z the sub-frame.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) buffer Planes { COMPLEX planes[]; };
// Factors of each sub-pixel along y for all rows, then along x for all columns.
layout(std430, binding = 1) readonly buffer Offsets { vec2 factors[]; };
layout(std430, binding = 2) buffer Field { COMPLEX field[]; };
layout(push_constant) uniform Args {
    uint height, width, subpixels;
    // If `columns` is not 0, the axis is along columns, otherwise along rows. If `back` is not 0, this is the
    // transpose.
    uint columns, back;
    // Number of values from one plane, or sub-frame, to the next.
    uint planes_stride, field_stride;
};

vec2 times(vec2 a, vec2 b) { return vec2(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x); }
vec2 transposed(vec2 a, vec2 b) { return times(vec2(a.x, -a.y), b); }

void main() {
    uint x = gl_GlobalInvocationID.x, frame = gl_GlobalInvocationID.z, p = subpixels;
    if (x >= width) return;
    uint along_x = p * height + x;
    for (uint y = gl_WorkGroupID.y; y < height; y += gl_NumWorkGroups.y) {
        uint at = y * width + x, start = frame * p * p * planes_stride + at, point = frame * field_stride + at;
        vec2 sum = vec2(0.0);
        for (uint a = 0; a < p; a++) {
            uint first = start + a * p * planes_stride;
            if (columns != 0) {
                if (back == 0) sum += times(factors[a * height + y], LOAD(planes[first]));
                else planes[first] = STORE(transposed(factors[a * height + y], LOAD(field[point])));
                continue;
            }
            vec2 value = back == 0 ? vec2(0.0) : LOAD(planes[first]);
            for (uint b = 0; b < p; b++) {
                uint one = first + b * planes_stride;
                vec2 factor = factors[along_x + b * width];
                if (back == 0) value += times(factor, LOAD(planes[one]));
                else planes[one] = STORE(transposed(factor, value));
            }
            if (back == 0) planes[first] = STORE(value);
        }
        if (columns != 0 && back == 0) field[point] = STORE(sum);
    }
}
