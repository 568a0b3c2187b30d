#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "alias.glsl"
#include "constants.glsl"
#include "binary_angle.glsl"

// Writes the levels of one color's sub-frames at their bits of the video frame. The first run writes the whole frame,
// and later runs OR their bits into it. An invocation takes four pixels of a row with all their cells. These fill whole
// words of the video frame, whose rows are padded to whole words. x is the group of four pixels (64 invocations), y the
// row of pixels (strided). If rows follow each other without gaps on both sides, rows do not matter. x is then the
// group of four or sixteen pixels of the whole picture (strided).
// The entries of a run are constants of the pipeline, so no invocation looks them up.
// The float operations are exact, and all others are on integers. The CPU twin therefore has the same bytes.

layout(local_size_x = WIDTH) in;
layout(constant_id = 0) const uint channels = 1;
// With ENCODE_POWER, levels are a power of two. With ENCODE_EVEN, they are at most 256 even levels, and with ENCODE_FINE
// more of them. With ENCODE_FINE_TABLED, the table has two bytes per entry, otherwise one.
layout(constant_id = 1) const uint kind = 0;
layout(constant_id = 2) const bool has_offsets = false;
layout(constant_id = 3) const uint cell_rows = 1;
layout(constant_id = 4) const uint cell_columns = 1;
layout(constant_id = 5) const uint levels = 256;
// Number of entries of this run.
layout(constant_id = 6) const uint count = 1;
// True if an earlier run has written this frame. The first run writes all of it.
layout(constant_id = 7) const bool follows = false;
// True if the phases of four pixels are contiguous, from a multiple of four on.
layout(constant_id = 8) const bool aligned = false;
// True if every entry takes all bits of the level.
layout(constant_id = 9) const bool entire = false;
// Number of values from one sub-frame to the next.
layout(constant_id = 10) const uint stride = 0;
// ENCODE_ROWS goes row by row. With another value, rows follow each other in the hologram and in the frame. With
// ENCODE_WIDE, one entry also fills whole words of the frame, and an invocation writes four of them at once.
layout(constant_id = 11) const uint flat_words = 0;
// The entries have the fields sub-frame (8 bits), mask (8), from, to and channel (4 each).
layout(constant_id = 12) const uint entry0 = 0;
layout(constant_id = 13) const uint entry1 = 0;
layout(constant_id = 14) const uint entry2 = 0;
layout(constant_id = 15) const uint entry3 = 0;
layout(constant_id = 16) const uint entry4 = 0;
layout(constant_id = 17) const uint entry5 = 0;
layout(constant_id = 18) const uint entry6 = 0;
layout(constant_id = 19) const uint entry7 = 0;
layout(constant_id = 20) const uint entry8 = 0;
layout(constant_id = 21) const uint entry9 = 0;
layout(constant_id = 22) const uint entry10 = 0;
layout(constant_id = 23) const uint entry11 = 0;
layout(constant_id = 24) const uint entry12 = 0;
layout(constant_id = 25) const uint entry13 = 0;
layout(constant_id = 26) const uint entry14 = 0;
layout(constant_id = 27) const uint entry15 = 0;
layout(constant_id = 28) const uint entry16 = 0;
layout(constant_id = 29) const uint entry17 = 0;
layout(constant_id = 30) const uint entry18 = 0;
layout(constant_id = 31) const uint entry19 = 0;
layout(constant_id = 32) const uint entry20 = 0;
layout(constant_id = 33) const uint entry21 = 0;
layout(constant_id = 34) const uint entry22 = 0;
layout(constant_id = 35) const uint entry23 = 0;
// True if phases are binary angles, as in binary_angle.rs, instead of float32.
layout(constant_id = 36) const bool angles = false;
layout(std430, binding = 0) readonly buffer Phases { float phases[]; };
layout(std430, binding = 0) readonly buffer Fours { vec4 fours[]; };
layout(std430, binding = 0) readonly buffer Angles { uint angle_pairs[]; };
layout(std430, binding = 0) readonly buffer AngleFours { uvec2 angle_fours[]; };
layout(std430, binding = 1) readonly buffer Offsets { uint offsets[]; };
// The table has four entries per word, or two.
layout(std430, binding = 2) readonly buffer Table { uint table[]; };
MAY_ALIAS layout(std430, binding = 3) buffer Frame { uint frame[]; };
MAY_ALIAS layout(std430, binding = 3) buffer Wide { uvec4 wide[]; };
void put(uint word, uint bits) {
    frame[word] = follows ? frame[word] | bits : bits;
}

layout(push_constant) uniform Args {
    uint height, width, first, step_y, step_x, shift_y, shift_x, rows, columns, bytes, flips;
    // Bit of the code for each cell, with 4 bits per cell.
    uint cells;
};

float phase_at(uint i) {
    return angles ? angle_value(angle_pairs[i / 2] >> (16 * (i & 1))) : phases[i];
}

vec4 four_at(uint i) {
    if (!angles) return fours[i];
    uvec2 a = angle_fours[i];
    return vec4(angle_value(a.x), angle_value(a.x >> 16), angle_value(a.y), angle_value(a.y >> 16));
}

// The compiler folds this if it knows `k`.
uint entry(uint k) {
    const uint all[ENCODE_ENTRIES] = uint[](
        entry0, entry1, entry2, entry3, entry4, entry5, entry6, entry7, entry8, entry9, entry10, entry11, entry12,
        entry13, entry14, entry15, entry16, entry17, entry18, entry19, entry20, entry21, entry22, entry23);
    return all[k];
}

uint turns(float phase) {
    float nearest = roundEven(phase);
    precise float rest = phase - nearest;
    precise float scaled = rest * ENCODE_PARTS;
    int whole = int(nearest);
    int part = int(roundEven(scaled));
    return uint(whole * ENCODE_RADIAN + ((whole * ENCODE_RADIAN_256TH) >> 8) + (part >> 10) * ENCODE_PART
        + (((part & 1023) * ENCODE_PART_128TH) >> 7));
}

uint level_of(uint t) {
    if (kind == ENCODE_POWER) {
        uint bits = uint(findMSB(levels));
        return (t + (1u << (31 - bits))) >> (32 - bits);
    } else if (kind == ENCODE_EVEN) {
        uint level = ((t >> 8) * levels + (1u << 23)) >> 24;
        return level == levels ? 0 : level;
    } else if (kind == ENCODE_FINE) {
        // The product of t and levels over 2^16, rounded down.
        uint sum = (t >> 16) * levels + (((t & 0xffffu) * levels) >> 16);
        uint level = (sum >> 16) + ((sum >> 15) & 1);
        return level == levels ? 0 : level;
    }
    uint at = t >> 16;
    if (kind == ENCODE_FINE_TABLED) return (table[at >> 1] >> (16 * (at & 1))) & 0xffffu;
    return (table[at >> 2] >> (8 * (at & 3))) & 255u;
}

// Returns the bits that an entry takes from the level of a phase, at their place in the pixel.
uint bits_of(uint place, float phase, uint offset) {
    uint level = level_of(turns(phase) + offset), to = 8 * (place & 15) + ((place >> 4) & 15);
    return (entire ? level : (level >> ((place >> 8) & 15)) & ((place >> 16) & 255u)) << to;
}

uint offset_at(uint pixel) {
    return has_offsets ? offsets[pixel] : 0;
}

// Joins the bytes of four pixels into a word.
uint joined(uvec4 p) {
    return p.x | p.y << 8 | p.z << 16 | p.w << 24;
}

// Returns four pixels of an entry.
uvec4 four_of(uint place, uint four) {
    vec4 phase = four_at((place >> 24) * (stride / 4) + four);
    uvec4 p;
    [[unroll]] for (uint i = 0; i < 4; i++) p[i] = bits_of(place, phase[i], offset_at(4 * four + i));
    return p;
}

void put_fours(uint four) {
    uvec4 p = uvec4(0);
    [[unroll]] for (uint k = 0; k < count; k++) p |= four_of(entry(k), four);
    if (channels == 1) {
        put(four, joined(p));
    } else {
        put(3 * four, p.x | p.y << 24);
        put(3 * four + 1, p.y >> 8 | p.z << 16);
        put(3 * four + 2, p.z >> 16 | p.w << 8);
    }
}

void put_wide(uint word) {
    uvec4 words;
    [[unroll]] for (uint j = 0; j < 4; j++) words[j] = joined(four_of(entry(0), 4 * word + j));
    wide[word] = words;
}

void main() {
    if (flat_words != ENCODE_ROWS) {
        uint all = width / 4 * height / (flat_words == ENCODE_WIDE ? 4 : 1);
        for (uint i = gl_GlobalInvocationID.x; i < all; i += WIDTH * gl_NumWorkGroups.x) {
            if (flat_words == ENCODE_WIDE) put_wide(i);
            else put_fours(i);
        }
        return;
    }
    uint four = gl_GlobalInvocationID.x;
    if (4 * four >= width) return;
    const uint across = 4 * cell_columns;
    uint words = channels * cell_columns * ((width + 3) / 4);
    for (uint row = gl_WorkGroupID.y; row < height; row += gl_NumWorkGroups.y) {
        uint y = (flips & 2) != 0 ? height - 1 - row : row;
        uint yy = y + shift_y;
        yy = yy >= height ? yy - height : yy;
        uint source[4], offset[4];
        [[unroll]] for (uint i = 0; i < 4; i++) {
            // Beyond the edge this repeats the last pixel. The result is in the padding.
            uint x = min(4 * four + i, width - 1);
            x = (flips & 1) != 0 ? width - 1 - x : x;
            uint xx = x + shift_x;
            xx = xx >= width ? xx - width : xx;
            source[i] = first + yy * step_y + xx * step_x;
            offset[i] = offset_at(y * width + x);
        }
        // Pixels of the video frame for the cells of these four pixels, by row of cells and then by column, at most 16.
        uint pixel[16];
        [[unroll]] for (uint i = 0; i < 16; i++) pixel[i] = 0;
        [[unroll]] for (uint k = 0; k < count; k++) {
            uint place = entry(k);
            uint base = (place >> 24) * stride, to = 8 * (place & 15) + ((place >> 4) & 15);
            vec4 phase;
            if (aligned) {
                phase = four_at((base + source[0]) / 4);
            } else {
                [[unroll]] for (uint i = 0; i < 4; i++) phase[i] = phase_at(base + source[i]);
            }
            [[unroll]] for (uint i = 0; i < 4; i++) {
                if (cell_rows * cell_columns == 1) {
                    pixel[i] |= bits_of(place, phase[i], offset[i]);
                } else {
                    uint level = level_of(turns(phase[i]) + offset[i]);
                    [[unroll]] for (uint j = 0; j < cell_rows; j++) {
                        [[unroll]] for (uint c = 0; c < cell_columns; c++) {
                            // A flip of the video frame also flips the cells of a pixel.
                            uint cy = (flips & 2) != 0 ? cell_rows - 1 - j : j;
                            uint cx = (flips & 1) != 0 ? cell_columns - 1 - c : c;
                            uint bit = (cells >> (4 * (cy * cell_columns + cx))) & 15;
                            pixel[j * across + i * cell_columns + c] |= ((level >> bit) & 1) << to;
                        }
                    }
                }
            }
        }
        [[unroll]] for (uint j = 0; j < cell_rows; j++) {
            uint word = (row * cell_rows + j) * words + channels * cell_columns * four;
            [[unroll]] for (uint g = 0; g < cell_columns; g++) {
                uint p = j * across + 4 * g;
                if (channels == 1) {
                    put(word + g, pixel[p] | pixel[p + 1] << 8 | pixel[p + 2] << 16 | pixel[p + 3] << 24);
                } else {
                    put(word + 3 * g, pixel[p] | pixel[p + 1] << 24);
                    put(word + 3 * g + 1, pixel[p + 1] >> 8 | pixel[p + 2] << 16);
                    put(word + 3 * g + 2, pixel[p + 2] >> 16 | pixel[p + 3] << 8);
                }
            }
        }
    }
}
