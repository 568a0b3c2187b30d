#version 450
#extension GL_GOOGLE_include_directive : require

// Transforms whole rows or whole columns, in place. Rows skip columns that are not in use. The forward transform does
// not write them, and the inverse takes them as zero.

#include "alias.glsl"
#include "half.glsl"
#include "fft_lines.glsl"

MAY_ALIAS layout(std430, binding = 0) buffer Data2 { COMPLEX data2[]; };
MAY_ALIAS layout(std430, binding = 0) buffer Data4 { COMPLEX2 data4[]; };
layout(push_constant) uniform Args {
    // `points` is the length. `count` and `all` are the rows of a frame and of all frames, or the number of columns and
    // the number before they wrap.
    uint points, count, all;
    uint inverse;
    // Number of values from row to row, and from frame to frame.
    uint row, frame;
    // First column, and the number of columns in use.
    uint first, used;
};

uint origin;

bool skipped(uint i, uint on_the_way) { return COLUMNS == 0u && inverse == on_the_way && !in_use(i, first, used); }

// Returns the index of the pair with value i.
uint place2(uint i) { return COLUMNS == 1u ? origin + i * (row / 2u) : (origin + i) / 2u; }

vec4 fetch4(uint way, uint i) { return skipped(i, 1u) ? vec4(0.0) : LOAD2(data4[place2(i)]); }
vec2 fetch2(uint way, uint i) { return skipped(i, 1u) ? vec2(0.0) : LOAD(data2[origin + i]); }
void put4(uint way, uint i, vec4 z) {
    if (!skipped(i, 0u)) data4[place2(i)] = STORE2(z);
}
void put2(uint way, uint i, vec2 z) {
    if (!skipped(i, 0u)) data2[origin + i] = STORE(z);
}

void main() {
    n = points;
    area = gl_LocalInvocationID.y;
    if (COLUMNS == 1u) {
        uint pair = gl_WorkGroupID.x * LINES + gl_LocalInvocationID.x;
        present = 2u * pair < count;
        uint column = first + 2u * pair;
        if (column >= all) column -= all;
        origin = (gl_WorkGroupID.y * frame + column) / 2u;
    } else {
        uint line = (gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x) * LINES + gl_LocalInvocationID.y;
        present = line < all;
        uint z = line / count;
        origin = z * frame + (line - z * count) * row;
    }
    transform(0u, inverse == 1u);
}
