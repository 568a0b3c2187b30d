// Shared by the kernels of reliefs (see relief.rs). A surface is a plane of disparities, then colors of three values.

#define RELIEF_ARGS uint height, width, pad, plane, reach; float tear;

// The neighbors of a pixel, with the closest first.
const ivec2 AROUND[8] = ivec2[](
    ivec2(-1, 0), ivec2(1, 0), ivec2(0, -1), ivec2(0, 1), ivec2(-1, -1), ivec2(1, -1), ivec2(-1, 1), ivec2(1, 1));

// Columns and rows of the continued picture.
#define RELIEF_SIZE ivec2(width + 2 * pad, height + 2 * pad)

bool is_inside(ivec2 place, ivec2 size) { return all(greaterThanEqual(place, ivec2(0))) && all(lessThan(place, size)); }

ivec2 place_of(uint pixel, ivec2 size) { return ivec2(pixel % uint(size.x), pixel / uint(size.x)); }

uint pixel_of(ivec2 place, ivec2 size) { return uint(place.y * size.x + place.x); }

bool is_like(float one, float other, float difference) { return abs(one - other) <= difference; }

// Returns the bits of a number that have the order of numbers.
uint ordered(float value) {
    uint bits = floatBitsToUint(value);
    return bits >> 31 == 0 ? bits | 0x80000000u : ~bits;
}

// Returns the columns and rows to a rim.
ivec2 rim_offset(uint packed) { return ivec2(bitfieldExtract(int(packed), 0, 16), bitfieldExtract(int(packed), 16, 16)); }

// Levels of disparity (see relief_levels.rs).
#define RELIEF_LEVEL_ARGS float low, high, level_scale;
#define LEVEL_OF(disparity) min(uint(max((high - (disparity)) * level_scale, 0.0)), RELIEF_LEVELS - 1)
