#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "binary_angle.glsl"

// Looks up first phases in a table (see table_start.rs). Arithmetic is in whole numbers, except for the last product,
// which is exact. Every device therefore has the same result. x is the word of two pixels (strided), y the sub-frame
// (strided).

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Light { uint light[]; };
// One over the light that each pixel has, in units of 1 / 65536. The shader does not read it if evenly_lit is not 0.
layout(std430, binding = 1) readonly buffer Needs { uint needs[]; };
// Binary angles (sub-frames, side, side, levels), two per word.
layout(std430, binding = 2) readonly buffer Table { uint table[]; };
layout(std430, binding = 3) writeonly buffer Phases { uint phases[]; };

layout(push_constant) uniform Args {
    // Sizes, the first sub-frame of the dispatch in the table, and the number of its sub-frames.
    uint height, width, side, first, frames;
    // Conversion from light to levels, light * factor >> shift, in units of 1 / 65536 of a fine level.
    uint factor, shift;
    uint evenly_lit;
    // Number of values from one sub-frame to the next, which is even. `angles` is not 0 if phases are binary angles.
    uint stride, angles;
};

const uint BEND = START_BEND << 16, END = ((START_LEVELS - 1) << 16) - 1;

// Returns (high, low) >> by, for `by` from 1 to 63, limited to 2^31.
uint shifted(uint high, uint low, uint by) {
    uint shifted = by >= 32 ? high >> (by - 32) : high << (32 - by) | low >> by;
    bool is_more = by < 32 && (high >> by) != 0;
    return is_more ? 0x80000000u : min(shifted, 0x80000000u);
}

// Returns the position of a pixel's light among the levels.
uint place(uint i) {
    uint high, low;
    umulExtended(light[i], factor, high, low);
    uint at = shifted(high, low, shift);
    if (evenly_lit == 0) {
        umulExtended(at, needs[i], high, low);
        at = shifted(high, low, 16);
    }
    return min(at < BEND ? at : BEND + (at - BEND) / START_COARSER, END);
}

uint angle_of(uint frame, uint i) {
    uint at = place(i);
    uint entry = (((first + frame) * side + i / width % side) * side + i % width % side) * START_LEVELS + (at >> 16);
    int from = int((table[entry >> 1] >> ((entry & 1u) << 4)) & 0xffffu);
    uint next = entry + 1;
    int to = int((table[next >> 1] >> ((next & 1u) << 4)) & 0xffffu);
    int turn = ((to - from) << 16) >> 16;
    return uint(from + ((turn * int(at & 0xffffu) + 32768) >> 16)) & 0xffffu;
}

void main() {
    uint pixels = height * width, step_size = gl_NumWorkGroups.x * WIDTH;
    for (uint frame = gl_WorkGroupID.y; frame < frames; frame += gl_NumWorkGroups.y) {
        for (uint word = gl_GlobalInvocationID.x; word < (pixels + 1) / 2; word += step_size) {
            uint i = 2 * word, at = frame * stride + i;
            uint low = angle_of(frame, i), high = i + 1 < pixels ? angle_of(frame, i + 1) : 0;
            if (angles != 0) {
                phases[at / 2] = low | high << 16;
                continue;
            }
            phases[at] = floatBitsToUint(angle_value(low));
            if (i + 1 < pixels) phases[at + 1] = floatBitsToUint(angle_value(high));
        }
    }
}
