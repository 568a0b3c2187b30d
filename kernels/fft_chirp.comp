#version 450
#extension GL_GOOGLE_include_directive : require
#include "alias.glsl"
#include "constants.glsl"
#include "half.glsl"

// Computes the products around the inner transforms of Bluestein's algorithm (1970). A transform of any length n is a
// convolution with a chirp, computed by transforms of a length m >= 2 n - 1. For columns, x is the column and y the
// element. For rows, x is the element and y the row. z is the frame. The work buffer is compact. It has lines of m
// elements, and leaves out lines that are not requested. It is in float32 for any type of data, because a convolution
// has intermediate values far beyond its input and output.

layout(local_size_x = CHIRP_WIDTH, local_size_y = CHIRP_HEIGHT) in;
MAY_ALIAS layout(std430, binding = 0) buffer Data { COMPLEX data[]; };
MAY_ALIAS layout(std430, binding = 1) buffer Work { vec2 work[]; };
// The chirp exp(-i pi k^2 / n), or the transform of its inverse.
layout(std430, binding = 2) readonly buffer Table { vec2 table[]; };
layout(push_constant) uniform Args {
    // CHIRP_BEGIN computes work = data chirp, and zeros. CHIRP_FILTER computes work = work filter. CHIRP_END computes
    // data = work chirp.
    uint mode;
    uint n, m;
    uint inverse, rows;
    // First line, number of lines, and number of columns before they wrap.
    uint first, count, wrap;
    uint data_row, data_frame, work_row, work_frame;
};

vec2 times(vec2 a, vec2 b) { return vec2(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x); }

void main() {
    uint x = gl_GlobalInvocationID.x, y = gl_GlobalInvocationID.y, z = gl_GlobalInvocationID.z;
    uint element = rows == 1u ? x : y, line = rows == 1u ? y : x;
    if (line >= count || element >= (mode == CHIRP_END ? n : m)) return;
    uint from = first + line;
    if (from >= wrap) from -= wrap;
    uint d = z * data_frame + (rows == 1u ? from * data_row + element : element * data_row + from);
    uint w = z * work_frame + (rows == 1u ? line * work_row + element : element * work_row + line);
    if (mode == CHIRP_BEGIN) {
        vec2 value = vec2(0.0);
        if (element < n) {
            value = LOAD(data[d]);
            value = times(inverse == 1u ? value.yx : value, table[element]);
        }
        work[w] = value;
    } else if (mode == CHIRP_FILTER) {
        work[w] = times(work[w], table[element]);
    } else {
        vec2 value = times(work[w], table[element]);
        data[d] = STORE(inverse == 1u ? value.yx : value);
    }
}
