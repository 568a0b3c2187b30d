#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "constants.glsl"
#include "relief.glsl"

// Draws a view of a relief. The twin draws all pieces from near to far. Here each invocation finds the pieces that cover
// its pixel, in the blocks that may be seen in its tile, and keeps the nearest of them in their order. The arithmetic of
// a pixel has the order of relief_draw.rs.

const int SIDE = RELIEF_SIDE;
const uint LANES = SIDE * SIDE;

layout(local_size_x = SIDE, local_size_y = SIDE) in;
layout(std430, binding = 0) readonly buffer Front { float front[]; };
layout(std430, binding = 1) readonly buffer Fringe { float fringe[]; };
layout(std430, binding = 2) readonly buffer Hidden { float hidden[]; };
layout(std430, binding = 3) readonly buffer Ranges { vec4 ranges[]; };
layout(std430, binding = 4) writeonly buffer Views { float views[]; };
layout(std430, binding = 5) writeonly buffer Seen { vec2 seen[]; };

// The view is (u, v) views from the center, and all disparities are from `low` to `high`. `places` has the index of the
// plane of each of the first `colors` colors, in 8 bits. The view begins at `first` in each plane of `stride` values,
// and at `first_seen` in `seen`, which gets the coverage and the disparity.
layout(push_constant) uniform Args {
    RELIEF_ARGS
    float u, v, low, high;
    uint colors, places, first, stride, first_seen;
};

shared ivec2 blocks[LANES];
shared uint found;

// The pieces of the pixel, with the nearest first. Pieces of one disparity are in the order of their numbers, which
// begin with the fringes, then the surface in front, then the hidden one.
float depths[RELIEF_PIECES];
float areas[RELIEF_PIECES];
uint numbers[RELIEF_PIECES];

void insert(float depth, float area, uint number) {
    [[unroll]] for (uint i = 0; i < RELIEF_PIECES; ++i) {
        if (depth > depths[i] || (depth == depths[i] && number < numbers[i])) {
            float other_depth = depths[i], other_area = areas[i];
            uint other = numbers[i];
            depths[i] = depth;
            areas[i] = area;
            numbers[i] = number;
            depth = other_depth;
            area = other_area;
            number = other;
        }
    }
}

float far_surface(uint p) { return hidden[p] > RELIEF_ABSENT ? hidden[p] : front[p]; }

// Returns the disparity of the edge towards a neighbor.
float edge(ivec2 place, ivec2 size, float here, bool is_hidden) {
    if (!is_inside(place, size)) return here;
    uint q = pixel_of(place, size);
    float there = is_hidden ? far_surface(q) : front[q];
    precise float middle = 0.5 * (there + here);
    return is_like(there, here, tear) ? middle : here;
}

// Adds a piece if it covers the pixel. `layer` is 0 for a fringe, 1 for the surface in front, 2 for the hidden one.
void visit(ivec2 place, ivec2 size, ivec2 pixel, float here, uint layer, float opacity) {
    vec2 by = vec2(u, v), at = vec2(place - int(pad));
    if (any(greaterThanEqual(abs(at - by * here - vec2(pixel)), vec2(RELIEF_NEAR)))) return;
    vec4 edges = vec4(here);
    if (layer != 0) {
        edges.x = edge(place - ivec2(1, 0), size, here, layer == 2);
        edges.y = edge(place + ivec2(1, 0), size, here, layer == 2);
        edges.z = edge(place - ivec2(0, 1), size, here, layer == 2);
        edges.w = edge(place + ivec2(0, 1), size, here, layer == 2);
    }
    precise float left = max(at.x - u * edges.x, 0.0);
    precise float right = min(at.x + 1.0 - u * edges.y, float(width));
    precise float top = max(at.y - v * edges.z, 0.0);
    precise float bottom = min(at.y + 1.0 - v * edges.w, float(height));
    if (right <= left || bottom <= top) return;
    precise float tall = min(bottom, float(pixel.y) + 1.0) - max(top, float(pixel.y));
    precise float wide = min(right, float(pixel.x) + 1.0) - max(left, float(pixel.x));
    if (tall <= 0.0 || wide <= 0.0) return;
    precise float area = tall * wide * opacity;
    insert(here, area, layer * plane + pixel_of(place, size));
}

// Returns true if pixels from `corner` to before `end` with disparities between two ends may cover pixels from `tile` to
// before `tile_end`.
bool may_cover(ivec2 corner, ivec2 end, vec2 ends, ivec2 tile, ivec2 tile_end) {
    if (ends.x > ends.y) return false;
    vec2 one = vec2(u, v) * ends.x, other = vec2(u, v) * ends.y;
    vec2 first = vec2(corner - int(pad)) - max(one, other) - RELIEF_NEAR;
    vec2 last = vec2(end - 1 - int(pad)) - min(one, other) + RELIEF_NEAR;
    return all(lessThan(first, vec2(tile_end))) && all(greaterThan(last, vec2(tile - 1)));
}

// Visits the pixels of a block whose disparities are between two ends.
void visit_block(ivec2 corner, ivec2 end, vec2 ends, ivec2 size, ivec2 pixel, bool is_hidden) {
    if (!may_cover(corner, end, ends, pixel, pixel + 1)) return;
    vec2 one = vec2(u, v) * ends.x, other = vec2(u, v) * ends.y;
    ivec2 first = ivec2(floor(vec2(pixel) - RELIEF_NEAR + min(one, other))) + int(pad);
    ivec2 last = ivec2(ceil(vec2(pixel) + RELIEF_NEAR + max(one, other))) + int(pad);
    first = max(first, corner);
    last = min(last, end - 1);
    for (int y = first.y; y <= last.y; ++y) {
        for (int x = first.x; x <= last.x; ++x) {
            ivec2 place = ivec2(x, y);
            uint p = pixel_of(place, size);
            if (is_hidden) {
                if (hidden[p] > RELIEF_ABSENT) visit(place, size, pixel, hidden[p], 2, 1.0);
                continue;
            }
            visit(place, size, pixel, front[p], 1, 1.0);
            if (fringe[p] > RELIEF_ABSENT) visit(place, size, pixel, fringe[p], 0, fringe[plane + p]);
        }
    }
}

vec3 color_of(uint number) {
    uint layer = number / plane, p = number % plane;
    vec3 color;
    for (uint k = 0; k < 3; ++k) {
        if (layer == 0) color[k] = fringe[2 * plane + 3 * p + k];
        else if (layer == 1) color[k] = front[plane + 3 * p + k];
        else color[k] = hidden[plane + 3 * p + k];
    }
    return color;
}

void main() {
    ivec2 size = RELIEF_SIZE, tile = SIDE * ivec2(gl_WorkGroupID.xy), pixel = tile + ivec2(gl_LocalInvocationID.xy);
    uint lane = gl_LocalInvocationIndex;
    [[unroll]] for (uint i = 0; i < RELIEF_PIECES; ++i) {
        depths[i] = RELIEF_ABSENT;
        areas[i] = 0.0;
        numbers[i] = 0;
    }
    ivec2 across = (size + SIDE - 1) / SIDE;
    vec2 one = vec2(u, v) * low, other = vec2(u, v) * high;
    ivec2 first_block = ivec2(floor(vec2(tile) - RELIEF_NEAR + min(one, other))) + int(pad);
    ivec2 last_block = ivec2(ceil(vec2(tile + SIDE - 1) + RELIEF_NEAR + max(one, other))) + int(pad);
    first_block = clamp(first_block, ivec2(0), size - 1) / SIDE;
    last_block = clamp(last_block, ivec2(0), size - 1) / SIDE;
    ivec2 some = last_block - first_block + 1;
    for (uint begin = 0; begin < uint(some.x * some.y); begin += LANES) {
        // The blocks before are no longer read after this barrier.
        barrier();
        if (lane == 0) found = 0;
        barrier();
        if (begin + lane < uint(some.x * some.y)) {
            ivec2 block = first_block + place_of(begin + lane, some);
            ivec2 corner = SIDE * block, end = min(corner + SIDE, size);
            vec4 ends = ranges[pixel_of(block, across)];
            bool covers = may_cover(corner, end, ends.xy, tile, tile + SIDE)
                || may_cover(corner, end, ends.zw, tile, tile + SIDE);
            if (covers) blocks[atomicAdd(found, 1)] = block;
        }
        barrier();
        for (uint i = 0; i < found; ++i) {
            ivec2 corner = SIDE * blocks[i], end = min(corner + SIDE, size);
            vec4 ends = ranges[pixel_of(blocks[i], across)];
            visit_block(corner, end, ends.xy, size, pixel, false);
            visit_block(corner, end, ends.zw, size, pixel, true);
        }
    }
    if (pixel.x >= int(width) || pixel.y >= int(height)) return;
    precise float covered = 0.0, depth = 0.0;
    precise vec3 color = vec3(0.0);
    [[unroll]] for (uint i = 0; i < RELIEF_PIECES; ++i) {
        float free = 1.0 - covered;
        if (free <= 0.0 || depths[i] <= RELIEF_ABSENT) break;
        precise float share = min(areas[i] * RELIEF_LARGER, free);
        covered += share;
        depth += share * depths[i];
        color += share * color_of(numbers[i]);
    }
    uint at = uint(pixel.y) * width + uint(pixel.x);
    bool known = covered > RELIEF_KNOWN;
    for (uint k = 0; k < colors; ++k) {
        uint place = (places >> (8 * k) & 255u) * stride + first + at;
        views[place] = max(known ? color[k] / max(covered, 1e-6) : color[k], 0.0);
    }
    seen[first_seen + at] = vec2(covered, known ? depth / covered : 0.0);
}
