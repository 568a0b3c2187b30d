#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// transfer[j][k] *= rows[j] * columns[k]. x is the column, y the row (strided).

layout(local_size_x = WIDTH) in;
// The weights of all rows, then the weights of all columns.
layout(std430, binding = 0) readonly buffer Weights { float weights[]; };
layout(std430, binding = 1) buffer Transfer { vec2 transfer[]; };
layout(push_constant) uniform Args {
    uint rows, columns;
};

void main() {
    uint k = gl_GlobalInvocationID.x;
    if (k >= columns) return;
    float along = weights[rows + k];
    for (uint j = gl_WorkGroupID.y; j < rows; j += gl_NumWorkGroups.y) {
        transfer[j * columns + k] *= weights[j] * along;
    }
}
