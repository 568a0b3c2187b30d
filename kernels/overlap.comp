#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// hits += scale inside the spans. `scale` is the share of a pupil's light in its mode. x is the column, y the row
// (strided).

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Spans { uvec2 spans[]; };
layout(std430, binding = 1) buffer Hits { float hits[]; };
layout(push_constant) uniform Args {
    uint grid_height, grid_width, y0, x0, rows, columns;
    float scale;
};

void main() {
    uint k = gl_GlobalInvocationID.x;
    if (k >= columns) return;
    uint x = (x0 + k) % grid_width;
    for (uint j = gl_WorkGroupID.y; j < rows; j += gl_NumWorkGroups.y) {
        uvec2 span = spans[j];
        if (k >= span.x && k < span.y) hits[(y0 + j) % grid_height * grid_width + x] += scale;
    }
}
