#version 450
#extension GL_GOOGLE_include_directive : require
#include "alias.glsl"
#include "constants.glsl"
#include "half.glsl"

// Around the inner transforms of Bluestein's algorithm (1970): a transform of any length n is a convolution with a
// chirp, done by transforms of a length m >= 2 n - 1. Columns: x is the column, y the element. Rows: x is the element,
// y the row. z: frame. The work lies compact: lines of m elements, without those lines that are not wanted. It is in
// float32 whatever the data are in: a convolution reaches far beyond what it begins and ends with.

layout(local_size_x = CHIRP_WIDTH, local_size_y = CHIRP_HEIGHT) in;
MAY_ALIAS layout(std430, binding = 0) buffer Data { COMPLEX data[]; };
MAY_ALIAS layout(std430, binding = 1) buffer Work { vec2 work[]; };
// Chirp exp(-i pi k^2 / n), or the transform of its inverse.
layout(std430, binding = 2) readonly buffer Table { vec2 table[]; };
layout(push_constant) uniform Args {
    // CHIRP_BEGIN: work = data chirp, and zeros. CHIRP_FILTER: work = work filter. CHIRP_END: data = work chirp.
    uint mode;
    uint n, m;
    uint inverse, rows;
    // Lines: the first one, how many, and columns before they wrap.
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
