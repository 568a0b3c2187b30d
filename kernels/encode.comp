#version 450
#extension GL_EXT_control_flow_attributes : require

// The levels of one colour's sub-frames at their bits: frame = the first's, frame |= the others'. An invocation takes
// four pixels of a row, all their cells: whole words of the video frame, whose rows are padded to them. x: those fours
// (64 invocations), y: row of pixels (strided).
// The float operations are exact, all others are of integers: the twin has the same bytes.

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint channels = 1;
// 0: levels are a power of two, 1: any even levels, 2: the table.
layout(constant_id = 1) const uint kind = 0;
layout(constant_id = 2) const bool has_offsets = false;
layout(constant_id = 3) const uint cell_rows = 1;
layout(constant_id = 4) const uint cell_columns = 1;
layout(constant_id = 5) const uint levels = 256;
// Entries of this run: known when compiled, so that they are read once for all invocations.
layout(constant_id = 6) const uint count = 1;
// Whether a run came before it in this frame; the first writes all of it.
layout(constant_id = 7) const bool follows = false;
// Four pixels' phases lie side by side, at a multiple of four.
layout(constant_id = 8) const bool aligned = false;
// Every entry takes all bits of the level.
layout(constant_id = 9) const bool entire = false;

// Sub-frame (8 bits), mask (8), from, to, channel (4 each).
layout(std430, binding = 0) readonly buffer Slots { uint slots[]; };
layout(std430, binding = 1) readonly buffer Phases { float phases[]; };
layout(std430, binding = 1) readonly buffer Fours { vec4 fours[]; };
layout(std430, binding = 2) readonly buffer Offsets { uint offsets[]; };
// Four entries a word.
layout(std430, binding = 3) readonly buffer Table { uint table[]; };
layout(std430, binding = 4) buffer Frame { uint frame[]; };
void put(uint word, uint bits) {
    frame[word] = follows ? frame[word] | bits : bits;
}

layout(push_constant) uniform Args {
    uint height, width, first, step_y, step_x, shift_y, shift_x, rows, columns, bytes, flips;
    // The first entry; values from one sub-frame to the next; the code's bit of each cell, 4 bits each.
    uint first_slot, stride, cells;
};

uint turns(float phase) {
    float nearest = roundEven(phase);
    precise float rest = phase - nearest;
    precise float scaled = rest * 4194304.0;
    int whole = int(nearest);
    int part = int(roundEven(scaled));
    return uint(whole * 683565275 + ((whole * 148) >> 8) + (part >> 10) * 166886 + (((part & 1023) * 20861) >> 7));
}

uint level_of(uint t) {
    if (kind == 0) {
        uint bits = uint(findMSB(levels));
        return (t + (1u << (31 - bits))) >> (32 - bits);
    } else if (kind == 1) {
        uint level = ((t >> 8) * levels + (1u << 23)) >> 24;
        return level == levels ? 0 : level;
    }
    uint at = t >> 16;
    return (table[at >> 2] >> (8 * (at & 3))) & 255u;
}

void main() {
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
            // Beyond the edge the last pixel is taken: what it becomes lies in the padding.
            uint x = min(4 * four + i, width - 1);
            x = (flips & 1) != 0 ? width - 1 - x : x;
            uint xx = x + shift_x;
            xx = xx >= width ? xx - width : xx;
            source[i] = first + yy * step_y + xx * step_x;
            offset[i] = has_offsets ? offsets[y * width + x] : 0;
        }
        // Words of the video frame's pixels: cell rows of four pixels' cell columns, at most 16.
        uint pixel[16];
        [[unroll]] for (uint i = 0; i < 16; i++) pixel[i] = 0;
        [[unroll]] for (uint k = 0; k < count; k++) {
            uint slot = slots[first_slot + k];
            uint base = (slot >> 24) * stride, mask = (slot >> 16) & 255u;
            uint from = (slot >> 8) & 15, to = 8 * (slot & 15) + ((slot >> 4) & 15);
            vec4 phase;
            if (aligned) {
                phase = fours[(base + source[0]) / 4];
            } else {
                [[unroll]] for (uint i = 0; i < 4; i++) phase[i] = phases[base + source[i]];
            }
            [[unroll]] for (uint i = 0; i < 4; i++) {
                uint level = level_of(turns(phase[i]) + offset[i]);
                if (cell_rows * cell_columns == 1) {
                    pixel[i] |= (entire ? level : (level >> from) & mask) << to;
                } else {
                    [[unroll]] for (uint j = 0; j < cell_rows; j++) {
                        [[unroll]] for (uint c = 0; c < cell_columns; c++) {
                            // A flip of the video frame changes the places of cells too.
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
