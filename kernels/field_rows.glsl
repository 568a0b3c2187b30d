// Fuses the light on the SLM, which `value_at` returns, with the rows of the field's transform. It stores the columns
// in use of the rows' spectra. It uses arguments of the including shader.

#include "fft_lines.glsl"

MAY_ALIAS layout(std430, binding = 2) writeonly buffer Field2 { COMPLEX field2[]; };
MAY_ALIAS layout(std430, binding = 2) writeonly buffer Field4 { COMPLEX2 field4[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    // Columns in use, and the number of all rows.
    uint first, used, all;
    float scale;
    // Number of values from one frame to the next, in the input of `value_at` and in the field.
    uint lit_stride, field_stride;
};

// Returns the field of a pixel of the sub-frame that starts at `base`.
vec2 value_at(uint base, uint pixel);

// Start of the row's sub-frame, the row's first pixel in it, and the row's first value. `lit` is true for rows of the
// SLM.
uint base, from, origin;
bool lit;

vec2 fetch2(uint way, uint i) {
    // The difference is unsigned, so columns left of the SLM wrap to large values.
    return lit && i - left < width ? value_at(base, from + (i - left)) : vec2(0.0);
}
vec4 fetch4(uint way, uint i) { return vec4(fetch2(way, i), fetch2(way, i + 1u)); }
void put4(uint way, uint i, vec4 z) {
    if (in_use(i, first, used)) field4[(origin + i) / 2u] = STORE2(z);
}
void put2(uint way, uint i, vec2 z) {
    if (in_use(i, first, used)) field2[origin + i] = STORE(z);
}

void main() {
    n = grid_width;
    area = gl_LocalInvocationID.y;
    uint line = (gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x) * LINES + area;
    present = line < all;
    uint frame = line / grid_height, y = line - frame * grid_height;
    lit = y - top < height;
    base = frame * lit_stride;
    from = (y - top) * width;
    origin = frame * field_stride + y * grid_width;
    transform(0u, false);
}
