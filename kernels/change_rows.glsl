// The rows of the change's inverse transform: columns in use in. What comes of a pixel of the SLM goes to `move`; the change of the
// field is stored nowhere. A shader's arguments have MORE of its own.

#include "fft_lines.glsl"

layout(std430, binding = 0) readonly buffer Change2 { COMPLEX change2[]; };
layout(std430, binding = 0) readonly buffer Change4 { COMPLEX2 change4[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    MORE
    // Columns in use, and rows in all, those of the SLM.
    uint first, used, all;
    // Values from one frame to the next: of the change, and of what is moved by it.
    uint change_stride, moved_stride;
};

// By a change, pixel `at` of the sub-frame that starts at `base`; and the next one.
void move(uint base, uint at, vec2 du);
void move_both(uint base, uint at, vec4 du);

// Where the row's first value is, its sub-frame's first phase, and its first pixel there.
uint origin, base, to;

vec4 fetch4(uint way, uint i) { return in_use(i, first, used) ? LOAD2(change4[(origin + i) / 2u]) : vec4(0.0); }
vec2 fetch2(uint way, uint i) { return in_use(i, first, used) ? LOAD(change2[origin + i]) : vec2(0.0); }
void put2(uint way, uint i, vec2 du) {
    // Unsigned: what lies left of the SLM wraps to something large.
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
