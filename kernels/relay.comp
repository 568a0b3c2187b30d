#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// transfer *= relay, inside the spans. x is the column, y the row (strided).

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Relay { vec2 relay[]; };
layout(std430, binding = 1) readonly buffer Spans { uvec2 spans[]; };
layout(std430, binding = 2) buffer Transfer { vec2 transfer[]; };
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
        if (k < span.x || k >= span.y) continue;
        vec2 z = transfer[j * columns + k], r = relay[(y0 + j) % grid_height * grid_width + x];
        transfer[j * columns + k] = vec2(z.x * r.x - z.y * r.y, z.x * r.y + z.y * r.x);
    }
}
