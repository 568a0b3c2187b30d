#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// accumulator (+)= sum over taps of weight * (view moved down by dy + fy and right by dx + fx), bilinear and periodic.
// Taps with the same (dy, fy) are neighbors. Their rows are added first, and each sum serves two rows of the result. x
// is the column, y a strip of PHOTOGRAPH_STRIP rows (strided) and z the pupil.

struct Tap {
    uint view;
    float weight;
    uint dy, dx;
    float fy, fx;
};

// Part of a pupil's sum that is over one block of views.
struct Shot {
    uint height, width, begin, end;
    float scale;
    uint accumulate;
    // Start of the level in the block and stride of its views, in u16 values, and start of the accumulator.
    uint views, view_stride, accumulator;
};

layout(local_size_x = WIDTH) in;
// Two u16 per word, with the first one in the low bits.
layout(std430, binding = 0) readonly buffer Views { uint views[]; };
layout(std430, binding = 1) readonly buffer Taps { Tap taps[]; };
layout(std430, binding = 2) buffer Accumulator { float accumulator[]; };
layout(std430, binding = 3) readonly buffer Shots { Shot shots[]; };
layout(push_constant) uniform Args {
    // The first shot of the dispatch, and the first value of the bound range.
    uint first, accumulator_base;
    // Rows of each pupil that this dispatch computes.
    uint top_row, end_row;
};

float value(uint at) {
    return float((views[at >> 1] >> ((at & 1u) << 4)) & 0xffffu);
}

void main() {
    Shot shot = shots[first + gl_WorkGroupID.z];
    uint x = gl_GlobalInvocationID.x, height = shot.height, width = shot.width;
    if (x >= width) return;
    uint end = min(height, end_row);
    for (uint y = top_row + gl_WorkGroupID.y * PHOTOGRAPH_STRIP; y < end; y += gl_NumWorkGroups.y * PHOTOGRAPH_STRIP) {
        float sums[PHOTOGRAPH_STRIP];
        for (uint r = 0; r < PHOTOGRAPH_STRIP; ++r) sums[r] = 0.0;
        for (uint i = shot.begin; i < shot.end;) {
            uint dy = taps[i].dy % height;
            float fy = taps[i].fy;
            // The first line is the row above the strip. If a view is smaller than the strip, its rows repeat.
            float lines[PHOTOGRAPH_STRIP + 1];
            for (uint r = 0; r <= PHOTOGRAPH_STRIP; ++r) lines[r] = 0.0;
            uint top = (y + height - dy + height - 1) % height;
            do {
                Tap tap = taps[i];
                uint dx = tap.dx % width;
                uint near_x = x >= dx ? x - dx : x + width - dx;
                uint far_x = near_x == 0 ? width - 1 : near_x - 1;
                float far = tap.weight * shot.scale * tap.fx;
                float near = tap.weight * shot.scale * (1.0 - tap.fx);
                uint row = top;
                for (uint r = 0; r <= PHOTOGRAPH_STRIP; ++r) {
                    uint base = shot.views + tap.view * shot.view_stride + row * width;
                    lines[r] += near * value(base + near_x) + far * value(base + far_x);
                    row = row + 1 == height ? 0 : row + 1;
                }
                ++i;
            } while (i < shot.end && taps[i].dy % height == dy && taps[i].fy == fy);
            for (uint r = 0; r < PHOTOGRAPH_STRIP; ++r) sums[r] += (1.0 - fy) * lines[r + 1] + fy * lines[r];
        }
        for (uint r = 0; r < PHOTOGRAPH_STRIP; ++r) {
            if (y + r >= height) break;
            uint at = shot.accumulator - accumulator_base + (y + r) * width + x;
            accumulator[at] = shot.accumulate == 0 ? sums[r] : accumulator[at] + sums[r];
        }
    }
}
