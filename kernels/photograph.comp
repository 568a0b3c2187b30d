#version 450

// accumulator (+)= sum over taps of weight * (view moved down by dy + fy and right by dx + fx), bilinear and periodic.
// x: column, y: row (strided).

struct Tap {
    uint view;
    float weight;
    uint dy, dx;
    float fy, fx;
};

layout(local_size_x = 64) in;
// Two u16 in a word, the first one low.
layout(std430, binding = 0) readonly buffer Views { uint views[]; };
layout(std430, binding = 1) readonly buffer Taps { Tap taps[]; };
layout(std430, binding = 2) buffer Accumulator { float accumulator[]; };
layout(push_constant) uniform Args {
    uint height, width, count;
    float scale;
    uint accumulate;
    // u16 values from one view to the next.
    uint view_stride;
};

float value(uint at) {
    return float((views[at >> 1] >> ((at & 1u) << 4)) & 0xffffu);
}

void main() {
    uint x = gl_GlobalInvocationID.x;
    if (x >= width) return;
    for (uint y = gl_WorkGroupID.y; y < height; y += gl_NumWorkGroups.y) {
        float sum = accumulate == 0 ? 0.0 : accumulator[y * width + x];
        for (uint i = 0; i < count; ++i) {
            Tap tap = taps[i];
            uint near_x = (x + width - tap.dx % width) % width;
            uint far_x = near_x == 0 ? width - 1 : near_x - 1;
            uint near_y = (y + height - tap.dy % height) % height;
            uint far_y = near_y == 0 ? height - 1 : near_y - 1;
            uint near_row = tap.view * view_stride + near_y * width;
            uint far_row = tap.view * view_stride + far_y * width;
            float near = mix(value(near_row + near_x), value(near_row + far_x), tap.fx);
            float far = mix(value(far_row + near_x), value(far_row + far_x), tap.fx);
            sum += tap.weight * scale * mix(near, far, tap.fy);
        }
        accumulator[y * width + x] = sum;
    }
}
