#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "constants.glsl"
#include "relief.glsl"

// Draws a view of a relief. The twin draws all pieces from near to far. Here each invocation goes through the levels of
// disparity that occur near its tile, from near to far. It finds the pieces of a level that cover its pixel, and keeps
// the nearest of them in their order. The arithmetic of a pixel has the order of relief_draw.rs.

const int SIDE = RELIEF_SIDE;
const uint LANES = SIDE * SIDE;

layout(local_size_x = SIDE, local_size_y = SIDE) in;
layout(std430, binding = 0) readonly buffer Front { float front[]; };
layout(std430, binding = 1) readonly buffer Fringe { float fringe[]; };
layout(std430, binding = 2) readonly buffer Hidden { float hidden[]; };
layout(std430, binding = 3) readonly buffer Marks { uvec2 marks[]; };
layout(std430, binding = 4) writeonly buffer Views { float views[]; };
layout(std430, binding = 5) writeonly buffer Seen { vec2 seen[]; };

// The view is (u, v) views from the center. `places` has the index of the plane of each of the first `colors` colors, in
// 8 bits. The view begins at `first` in each plane of `stride` values. `seen` gets its coverage and its disparity.
layout(push_constant) uniform Args {
    RELIEF_ARGS RELIEF_LEVEL_ARGS
    float u, v;
    uint colors, places, first, stride;
};

shared uint seen_levels, hidden_levels;

// The pieces of a level, with the nearest first. Pieces of one disparity are in the order of their numbers, which begin
// with the fringes, then the surface in front, then the hidden one.
float depths[RELIEF_PIECES];
float areas[RELIEF_PIECES];
uint numbers[RELIEF_PIECES];

void insert(float depth, float area, uint number) {
    [[unroll]] for (uint i = 0; i < RELIEF_PIECES; ++i) {
        bool is_nearer = depth > depths[i] || (depth == depths[i] && number < numbers[i]);
        float other_depth = depths[i], other_area = areas[i];
        uint other = numbers[i];
        depths[i] = is_nearer ? depth : other_depth;
        areas[i] = is_nearer ? area : other_area;
        numbers[i] = is_nearer ? number : other;
        depth = is_nearer ? other_depth : depth;
        area = is_nearer ? other_area : area;
        number = is_nearer ? other : number;
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
    vec2 at = vec2(place - int(pad));
    if (any(greaterThanEqual(abs(at - vec2(u, v) * here - vec2(pixel)), vec2(RELIEF_NEAR)))) return;
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

// Returns the smallest and the largest disparity of a level.
vec2 ends_of(uint level) {
    if (level_scale == 0.0) return vec2(low, high);
    return vec2(high - float(level + 1) / level_scale, high - float(level) / level_scale);
}

// Returns the levels of a word that may cover the tile, for a block from `corner` to before `end`.
uint levels_at(uint word, ivec2 corner, ivec2 end, ivec2 tile) {
    uint near = 0;
    for (uint rest = word; rest != 0; rest &= rest - 1) {
        uint level = findLSB(rest);
        vec2 ends = ends_of(level);
        vec2 one = vec2(u, v) * ends.x, other = vec2(u, v) * ends.y;
        vec2 from = vec2(corner - int(pad)) - max(one, other) - RELIEF_NEAR;
        vec2 to = vec2(end - 1 - int(pad)) - min(one, other) + RELIEF_NEAR;
        if (all(lessThan(from, vec2(tile + SIDE))) && all(greaterThan(to, vec2(tile - 1)))) near |= 1u << level;
    }
    return near;
}

// Finds the levels that may cover the tile. The blocks are shared by all invocations.
void find_levels(uint lane, ivec2 size, ivec2 tile) {
    if (lane == 0) seen_levels = hidden_levels = 0;
    barrier();
    ivec2 across = (size + SIDE - 1) / SIDE;
    vec2 one = vec2(u, v) * low, other = vec2(u, v) * high;
    ivec2 from = ivec2(floor(vec2(tile) - RELIEF_NEAR + min(one, other))) + int(pad);
    ivec2 to = ivec2(ceil(vec2(tile + SIDE - 1) + RELIEF_NEAR + max(one, other))) + int(pad);
    from = clamp(from, ivec2(0), size - 1) / SIDE;
    ivec2 some = clamp(to, ivec2(0), size - 1) / SIDE - from + 1;
    uvec2 near = uvec2(0);
    for (uint at = lane; at < uint(some.x * some.y); at += LANES) {
        ivec2 block = from + place_of(at, some);
        ivec2 corner = SIDE * block, end = min(corner + SIDE, size);
        uvec2 words = marks[pixel_of(block, across)];
        near |= uvec2(levels_at(words.x, corner, end, tile), levels_at(words.y, corner, end, tile));
    }
    atomicOr(seen_levels, near.x);
    atomicOr(hidden_levels, near.y);
    barrier();
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
    find_levels(gl_LocalInvocationIndex, size, tile);
    if (pixel.x >= int(width) || pixel.y >= int(height)) return;
    precise float covered = 0.0, depth = 0.0;
    precise vec3 color = vec3(0.0);
    for (uint rest = seen_levels | hidden_levels; rest != 0 && covered < 1.0; rest &= rest - 1) {
        uint level = findLSB(rest);
        bool is_seen = (seen_levels >> level & 1u) != 0, is_hidden = (hidden_levels >> level & 1u) != 0;
        [[unroll]] for (uint i = 0; i < RELIEF_PIECES; ++i) {
            depths[i] = RELIEF_ABSENT;
            areas[i] = 0.0;
            numbers[i] = 0;
        }
        vec2 ends = ends_of(level);
        vec2 one = vec2(u, v) * ends.x, other = vec2(u, v) * ends.y;
        ivec2 from = max(ivec2(ceil(vec2(pixel) - RELIEF_NEAR + min(one, other))) + int(pad), ivec2(0));
        ivec2 to = min(ivec2(floor(vec2(pixel) + RELIEF_NEAR + max(one, other))) + int(pad), size - 1);
        for (int y = from.y; y <= to.y; ++y) {
            for (int x = from.x; x <= to.x; ++x) {
                ivec2 place = ivec2(x, y);
                uint p = pixel_of(place, size);
                float near = front[p], mixed = fringe[p], behind = is_hidden ? hidden[p] : RELIEF_ABSENT;
                if (is_seen && LEVEL_OF(near) == level) visit(place, size, pixel, near, 1, 1.0);
                if (is_seen && mixed > RELIEF_ABSENT && LEVEL_OF(mixed) == level) {
                    visit(place, size, pixel, mixed, 0, fringe[plane + p]);
                }
                if (behind > RELIEF_ABSENT && LEVEL_OF(behind) == level) visit(place, size, pixel, behind, 2, 1.0);
            }
        }
        [[unroll]] for (uint i = 0; i < RELIEF_PIECES; ++i) {
            float free = 1.0 - covered;
            if (free > 0.0 && depths[i] > RELIEF_ABSENT) {
                precise float share = min(areas[i] * RELIEF_LARGER, free);
                covered += share;
                depth += share * depths[i];
                color += share * color_of(numbers[i]);
            }
        }
    }
    uint at = uint(pixel.y) * width + uint(pixel.x);
    bool known = covered > RELIEF_KNOWN;
    for (uint k = 0; k < colors; ++k) {
        uint place = (places >> (8 * k) & 255u) * stride + first + at;
        views[place] = max(known ? color[k] / max(covered, 1e-6) : color[k], 0.0);
    }
    seen[at] = vec2(covered, known ? depth / covered : 0.0);
}
