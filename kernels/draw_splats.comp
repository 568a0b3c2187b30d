#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// Draws one tile of a picture of splats, nearest first. An invocation draws pixels of one column. All of them find the
// splats of the tile among the marked splats of its bin, and read them in batches. The arithmetic has the order of
// draw_splats.rs.

const uint ROWS = TILE_THREADS / SPLAT_SIDE;
const uint PIXELS = SPLAT_SIDE / ROWS;
// Counts of lanes that are summed together.
const uint PART = 16;

layout(local_size_x = TILE_THREADS) in;
layout(std430, binding = 0) readonly buffer Splats { uint splats[]; };
layout(std430, binding = 1) readonly buffer Marks { uint marks[]; };
layout(std430, binding = 2) writeonly buffer Picture { float picture[]; };

// `across` and `words` belong to the marks. Planes of the picture are `stride` values apart. If `light` is not 0,
// there are three, in linear light up to 1.
layout(push_constant) uniform Args { uint height, width, across, words, first, stride, light; };

// A batch of splats: (x, y, xx, xy), (yy, opacity, red, green), (blue, inverse) and (columns, rows).
shared vec4 shapes[TILE_THREADS];
shared vec4 paints[TILE_THREADS];
shared vec2 others[TILE_THREADS];
shared uvec2 spans[TILE_THREADS];
shared uint entries[TILE_THREADS];
shared uint counts[TILE_THREADS];
shared uint parts[TILE_THREADS / PART];
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

// Returns true if the splat touches the tile whose first pixel is `corner`.
bool touches(uint entry, uvec2 corner) {
    uvec2 span = uvec2(splats[SPLAT_WORDS * entry + 10], splats[SPLAT_WORDS * entry + 11]);
    return all(lessThan(span & 0xffffu, corner + SPLAT_SIDE)) && all(greaterThan(span >> 16, corner));
}

// Returns the light of a value in the sRGB curve.
float light_of(float value) {
    float v = clamp(value, 0.0, 1.0);
    return v <= 0.04045 ? v / 12.92 : min(pow((v + 0.055) / 1.055, 2.4), 1.0);
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
    uint bin = corner.y / SPLAT_BIN * across + corner.x / SPLAT_BIN;
    bool all_closed = false;
    for (uint begin = 0; begin < words && !all_closed; begin += TILE_THREADS * SPLAT_TOGETHER) {
        uint own_first = begin + lane * SPLAT_TOGETHER;
        uint bits[SPLAT_TOGETHER];
        uint own = 0;
        for (uint k = 0; k < SPLAT_TOGETHER; ++k) {
            uint marked = own_first + k < words ? marks[bin * words + own_first + k] : 0;
            uint kept = marked;
            while (marked != 0) {
                uint i = findLSB(marked);
                marked &= marked - 1;
                if (!touches(32 * (own_first + k) + i, corner)) kept &= ~(1u << i);
            }
            bits[k] = kept;
            own += bitCount(kept);
        }
        // The counts before are no longer read after this barrier.
        barrier();
        counts[lane] = own;
        barrier();
        if (lane < TILE_THREADS / PART) {
            uint sum = 0;
            for (uint i = 0; i < PART; ++i) sum += counts[PART * lane + i];
            parts[lane] = sum;
        }
        barrier();
        uint total = 0, before = 0;
        for (uint part = 0; part < TILE_THREADS / PART; ++part) {
            if (part < lane / PART) before += parts[part];
            total += parts[part];
        }
        for (uint i = lane / PART * PART; i < lane; ++i) before += counts[i];
        for (uint from = 0; from < total; from += TILE_THREADS) {
            // The batch before is no longer read after this barrier.
            barrier();
            if (lane == 0) some_open = 0;
            uint rank = before;
            for (uint k = 0; k < SPLAT_TOGETHER; ++k) {
                for (uint rest = bits[k]; rest != 0; rest &= rest - 1) {
                    if (rank - from < TILE_THREADS) entries[rank - from] = 32 * (own_first + k) + findLSB(rest);
                    ++rank;
                }
            }
            barrier();
            bool is_open = false;
            for (uint i = 0; i < PIXELS; ++i) is_open = is_open || open[i];
            if (is_open) atomicOr(some_open, 1u);
            if (from + lane < total) fetch(lane, entries[lane]);
            barrier();
            if (some_open == 0) {
                all_closed = true;
                break;
            }
            uint count = min(total - from, TILE_THREADS);
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
    }
    if (column >= width) return;
    for (uint i = 0; i < PIXELS; ++i) {
        uint y = row + i * ROWS;
        if (y >= height) break;
        uint at = first + y * width + column;
        if (light != 0) {
            for (uint k = 0; k < 3; ++k) picture[k * stride + at] = light_of(drawn[i][k]);
            continue;
        }
        for (uint k = 0; k < 4; ++k) picture[k * stride + at] = drawn[i][k];
        picture[4 * stride + at] = covered[i];
    }
}
