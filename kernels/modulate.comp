#version 450
#extension GL_GOOGLE_include_directive : require
#include "half.glsl"
#include "trig.glsl"
#define ANGLES_ID 0
#include "binary_angle.glsl"

// field = scale exp(i phases) on the SLM, zero in the padding around it. x is the column, y the row (strided) and z the
// frame.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Phases { uint phases[]; };
layout(std430, binding = 1) writeonly buffer Field { COMPLEX field[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    // Number of values from one frame to the next.
    uint phases_stride, field_stride;
    float scale;
};

void main() {
    uint x = gl_GlobalInvocationID.x;
    uint frame = gl_GlobalInvocationID.z;
    if (x >= grid_width) return;
    for (uint y = gl_WorkGroupID.y; y < grid_height; y += gl_NumWorkGroups.y) {
        vec2 value = vec2(0.0);
        // The differences are unsigned, so pixels above or left of the SLM wrap to large values.
        if (y - top < height && x - left < width) {
            uint at = frame * phases_stride + (y - top) * width + (x - left);
            value = scale * cos_sin(PHASE_AT(phases, at));
        }
        field[frame * field_stride + y * grid_width + x] = STORE(value);
    }
}
