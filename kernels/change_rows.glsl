// Transforms the rows of the change back, from the columns in use. The change of a pixel of the SLM goes to `move`, and
// the change of the field is not stored. MORE lists additional arguments of a shader.

#include "fft_lines.glsl"

layout(std430, binding = 0) readonly buffer Change2 { COMPLEX change2[]; };
layout(std430, binding = 0) readonly buffer Change4 { COMPLEX2 change4[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    MORE
    // Columns in use, and the number of all rows of the SLM.
    uint first, used, all;
    // Number of values from one frame to the next, in the change and in the buffers that it moves.
    uint change_stride, moved_stride;
};

// Moves pixel `at` of the sub-frame that starts at `base` by the change `du`. The second function also moves the next
// pixel.
void move(uint base, uint at, vec2 du);
void move_both(uint base, uint at, vec4 du);

// Index of the row's first value, of its sub-frame's first phase, and of the row's first pixel in the sub-frame.
uint origin, base, to;

vec4 fetch4(uint way, uint i) { return in_use(i, first, used) ? LOAD2(change4[(origin + i) / 2u]) : vec4(0.0); }
vec2 fetch2(uint way, uint i) { return in_use(i, first, used) ? LOAD(change2[origin + i]) : vec2(0.0); }
void put2(uint way, uint i, vec2 du) {
    // The difference is unsigned, so columns left of the SLM wrap to large values.
    if (i - left < width) move(base, to + (i - left), du);
}
void put4(uint way, uint i, vec4 z) {
    if (i - left < width && i + 1u - left < width) {
        move_both(base, to + (i - left), z);
        return;
    }
    put2(way, i, z.xy);
    put2(way, i + 1u, z.zw);
}

void main() {
    n = grid_width;
    area = gl_LocalInvocationID.y;
    uint line = (gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x) * LINES + area;
    present = line < all;
    uint frame = line / height, y = line - frame * height;
    origin = frame * change_stride + (top + y) * grid_width;
    base = frame * moved_stride;
    to = y * width;
    transform(0u, true);
}
