#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// found = 1 if any value is NaN or infinite. x is the value (strided), z the frame. This kernel exists for halves only
// (see check_finite.rs).

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Change { uint change[]; };
layout(std430, binding = 1) buffer Found { uint found; };
layout(push_constant) uniform Args {
    uint count;
    // Number of values from one frame to the next.
    uint change_stride;
};

void main() {
    uint base = gl_GlobalInvocationID.z * change_stride;
    bool none = false;
    for (uint i = gl_GlobalInvocationID.x; i < count; i += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        uint bits = change[base + i];
        none = none || (bits & 0x7c00u) == 0x7c00u || (bits & 0x7c000000u) == 0x7c000000u;
    }
    if (none) atomicOr(found, 1u);
}
