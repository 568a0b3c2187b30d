#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "half.glsl"

// change += scale * window * conj(transfer), inside the spans. x is the column, y the row (strided) and z the frame. A
// window is at most as large as the grid, so no two invocations add to the same value of `change`.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Window { COMPLEX window[]; };
layout(std430, binding = 1) readonly buffer Transfer { vec2 transfer[]; };
layout(std430, binding = 2) readonly buffer Spans { uvec2 spans[]; };
layout(std430, binding = 3) buffer Change { COMPLEX change[]; };
layout(push_constant) uniform Args {
    uint grid_height, grid_width, y0, x0, rows, columns;
    float scale;
    // Number of values from one frame to the next.
    uint change_stride, window_stride;
};

void main() {
    uint k = gl_GlobalInvocationID.x;
    uint frame = gl_GlobalInvocationID.z;
    if (k >= columns) return;
    uint x = (x0 + k) % grid_width;
    for (uint j = gl_WorkGroupID.y; j < rows; j += gl_NumWorkGroups.y) {
        uvec2 span = spans[j];
        if (k < span.x || k >= span.y) continue;
        uint y = (y0 + j) % grid_height;
        uint at = j * columns + k;
        vec2 v = LOAD(window[frame * window_stride + at]) * scale;
        vec2 t = transfer[at];
        uint to = frame * change_stride + y * grid_width + x;
        change[to] = STORE(LOAD(change[to]) + vec2(v.x * t.x + v.y * t.y, v.y * t.x - v.x * t.y));
    }
}
