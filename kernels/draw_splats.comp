#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// Draws one tile of a picture of splats, nearest first. An invocation draws pixels of one column. All of them read the
// list of the tile in batches. The arithmetic has the order of draw_splats.rs.

const uint ROWS = TILE_THREADS / SPLAT_SIDE;
const uint PIXELS = SPLAT_SIDE / ROWS;

layout(local_size_x = TILE_THREADS) in;
layout(std430, binding = 0) readonly buffer Splats { uint splats[]; };
layout(std430, binding = 1) readonly buffer First { uint first[]; };
layout(std430, binding = 2) readonly buffer Entries { uint entries[]; };
layout(std430, binding = 3) writeonly buffer Picture { float picture[]; };

layout(push_constant) uniform Args { uint height, width, across; };

// A batch of splats: (x, y, xx, xy), (yy, opacity, red, green), (blue, inverse) and (columns, rows).
shared vec4 shapes[TILE_THREADS];
shared vec4 paints[TILE_THREADS];
shared vec2 others[TILE_THREADS];
shared uvec2 spans[TILE_THREADS];
shared uint some_open;

// Returns the exponential of a number from -80 to 0.
float exponential(float power) {
    precise float turns = max(power * LOG2_E, -120.0);
    precise float rounded = turns + SPLAT_ROUND;
    precise float rest = turns - (rounded - SPLAT_ROUND);
    precise float series = 1.0
        + rest * (SPLAT_EXP_1
        + rest * (SPLAT_EXP_2
        + rest * (SPLAT_EXP_3 + rest * (SPLAT_EXP_4 + rest * (SPLAT_EXP_5 + rest * SPLAT_EXP_6)))));
    precise float value = series * uintBitsToFloat((floatBitsToUint(rounded) << 23) + 0x3f800000u);
    return value;
}

void fetch(uint lane, uint entry) {
    uint at = SPLAT_WORDS * entry;
    vec4 shape = vec4(0.0), paint = vec4(0.0);
    for (uint i = 0; i < 4; ++i) {
        shape[i] = uintBitsToFloat(splats[at + i]);
        paint[i] = uintBitsToFloat(splats[at + 4 + i]);
    }
    shapes[lane] = shape;
    paints[lane] = paint;
    others[lane] = vec2(uintBitsToFloat(splats[at + 8]), uintBitsToFloat(splats[at + 9]));
    spans[lane] = uvec2(splats[at + 10], splats[at + 11]);
}

void main() {
    uint lane = gl_LocalInvocationID.x;
    uvec2 corner = SPLAT_SIDE * gl_WorkGroupID.xy;
    uint column = corner.x + lane % SPLAT_SIDE, row = corner.y + lane / SPLAT_SIDE;
    vec4 drawn[PIXELS];
    float covered[PIXELS], clear[PIXELS];
    bool open[PIXELS];
    for (uint i = 0; i < PIXELS; ++i) {
        drawn[i] = vec4(0.0);
        covered[i] = 0.0;
        clear[i] = 1.0;
        open[i] = column < width && row + i * ROWS < height;
    }
    uint tile = gl_WorkGroupID.y * across + gl_WorkGroupID.x;
    uint end = first[tile + 1];
    for (uint begin = first[tile]; begin < end; begin += TILE_THREADS) {
        // The batch before is no longer read after this barrier.
        barrier();
        if (lane == 0) some_open = 0;
        barrier();
        bool is_open = false;
        for (uint i = 0; i < PIXELS; ++i) is_open = is_open || open[i];
        if (is_open) atomicOr(some_open, 1u);
        if (begin + lane < end) fetch(lane, entries[begin + lane]);
        barrier();
        if (some_open == 0) break;
        uint count = min(end - begin, TILE_THREADS);
        for (uint at = 0; at < count; ++at) {
            vec4 shape = shapes[at], paint = paints[at];
            uvec2 span = spans[at];
            // The twin computes SPLAT_LANES columns together.
            uint left = (span.x & 0xffffu) / SPLAT_LANES * SPLAT_LANES;
            uint right = ((span.x >> 16) + SPLAT_LANES - 1) / SPLAT_LANES * SPLAT_LANES;
            if (column < left || column >= right) continue;
            precise float dx = float(column) - shape.x;
            for (uint i = 0; i < PIXELS; ++i) {
                uint y = row + i * ROWS;
                if (!open[i] || y < (span.y & 0xffffu) || y >= span.y >> 16) continue;
                precise float dy = float(y) - shape.y;
                precise float power = -0.5 * (shape.z * dx * dx + paint.x * dy * dy) - shape.w * dx * dy;
                precise float alpha = min(paint.y * exponential(power), SPLAT_OPAQUE);
                if (!(alpha >= SPLAT_FAINTEST && power <= 0.0)) continue;
                precise float next = clear[i] * (1.0 - alpha);
                if (next < SPLAT_CLOSED) {
                    open[i] = false;
                    continue;
                }
                precise float share = alpha * clear[i];
                precise vec4 sum = drawn[i] + share * vec4(paint.zw, others[at]);
                drawn[i] = sum;
                covered[i] += share;
                clear[i] = next;
            }
        }
    }
    if (column >= width) return;
    uint plane = height * width;
    for (uint i = 0; i < PIXELS; ++i) {
        uint y = row + i * ROWS;
        if (y >= height) break;
        uint at = y * width + column;
        for (uint k = 0; k < 4; ++k) picture[k * plane + at] = drawn[i][k];
        picture[4 * plane + at] = covered[i];
    }
}
