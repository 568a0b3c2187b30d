#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// If a sum of the loss is not finite, or was not since the verdict was cleared, this sets the workgroups of the
// dispatches in `groups` to 0. The phases then stay as they are. There is one workgroup.

layout(local_size_x = SUM_WIDTH) in;
// Bits of float32. The first value is not 0 if `check_finite` found a fault.
layout(std430, binding = 0) readonly buffer Losses { uint losses[]; };
layout(std430, binding = 1) buffer Verdict { uint verdict; };
layout(std430, binding = 2) buffer Groups { uint groups[]; };

layout(push_constant) uniform Args {
    uint loss_count, group_count;
};

shared uint found;

void main() {
    uint first = gl_LocalInvocationIndex;
    if (first == 0) found = verdict | losses[0];
    barrier();
    bool none = false;
    for (uint i = first; i < loss_count; i += SUM_WIDTH) {
        none = none || (losses[i] & 0x7f800000u) == 0x7f800000u;
    }
    if (none) atomicOr(found, 1u);
    barrier();
    if (found == 0) return;
    if (first == 0) verdict = 1;
    for (uint i = first; i < group_count; i += SUM_WIDTH) groups[i] = 0;
}
