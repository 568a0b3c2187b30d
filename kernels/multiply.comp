#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "half.glsl"

// Multiplies the field by `scale`, and also by the factor (or its conjugate) at points that have one. x is the column,
// y the row (strided) and z the sub-frame.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) buffer Field { COMPLEX field[]; };
layout(std430, binding = 1) readonly buffer Mask { vec2 mask[]; };
layout(std430, binding = 2) readonly buffer Transfer { vec2 transfer[]; };
layout(push_constant) uniform Args {
    uint rows, columns, grid_height, grid_width, top, left;
    uint conjugate;
    float scale;
    // 1 if the factors are from the transfer, 0 if they are from the mask.
    uint propagates;
    // Number of values from one sub-frame to the next.
    uint field_stride;
};

void main() {
    uint x = gl_GlobalInvocationID.x, frame = gl_GlobalInvocationID.z;
    if (x >= grid_width) return;
    for (uint y = gl_WorkGroupID.y; y < grid_height; y += gl_NumWorkGroups.y) {
        uint at = frame * field_stride + y * grid_width + x;
        vec2 z = scale * LOAD(field[at]);
        // The differences are unsigned, so points above or left of the factors wrap to large values.
        if (y - top < rows && x - left < columns) {
            uint i = (y - top) * columns + (x - left);
            vec2 f = propagates != 0u ? transfer[i] : mask[i];
            f.y = conjugate != 0u ? -f.y : f.y;
            z = vec2(z.x * f.x - z.y * f.y, z.x * f.y + z.y * f.x);
        }
        field[at] = STORE(z);
    }
}
