#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "half.glsl"

// window = scale * spectrum * transfer inside the spans, zero outside. x is the column, y the row (strided) and z the
// frame.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Spectrum { COMPLEX spectrum[]; };
layout(std430, binding = 1) readonly buffer Transfer { vec2 transfer[]; };
layout(std430, binding = 2) readonly buffer Spans { uvec2 spans[]; };
layout(std430, binding = 3) writeonly buffer Window { COMPLEX window[]; };
layout(push_constant) uniform Args {
    uint grid_height, grid_width, y0, x0, rows, columns;
    float scale;
    // Number of values from one frame to the next.
    uint spectrum_stride, window_stride;
};

void main() {
    uint k = gl_GlobalInvocationID.x;
    uint frame = gl_GlobalInvocationID.z;
    if (k >= columns) return;
    uint x = (x0 + k) % grid_width;
    for (uint j = gl_WorkGroupID.y; j < rows; j += gl_NumWorkGroups.y) {
        vec2 value = vec2(0.0);
        uvec2 span = spans[j];
        uint at = j * columns + k;
        if (k >= span.x && k < span.y) {
            uint y = (y0 + j) % grid_height;
            vec2 u = LOAD(spectrum[frame * spectrum_stride + y * grid_width + x]) * scale;
            vec2 t = transfer[at];
            value = vec2(u.x * t.x - u.y * t.y, u.x * t.y + u.y * t.x);
        }
        window[frame * window_stride + at] = STORE(value);
    }
}
