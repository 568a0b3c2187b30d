#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// marks = a bit for each bin and splat, set if the splat touches the bin. An invocation marks all splats of a group in
// some bins.

const uint GROUP_WORDS = TILE_THREADS / 32;

layout(local_size_x = TILE_THREADS) in;
layout(std430, binding = 0) readonly buffer Splats { uint splats[]; };
layout(std430, binding = 1) writeonly buffer Marks { uint marks[]; };

layout(push_constant) uniform Args { uint count, across, bins, words; };

shared uvec2 spans[TILE_THREADS];

bool touches(uint span, uint from) { return (span & 0xffffu) < from + SPLAT_BIN && span >> 16 > from; }

void main() {
    uint lane = gl_LocalInvocationID.x;
    uint groups = (words + GROUP_WORDS - 1) / GROUP_WORDS;
    for (uint group = gl_WorkGroupID.x; group < groups; group += gl_NumWorkGroups.x) {
        uint at = group * TILE_THREADS + lane;
        // The spans of the group before are no longer read after this barrier.
        barrier();
        spans[lane] = at < count ? uvec2(splats[SPLAT_WORDS * at + 10], splats[SPLAT_WORDS * at + 11]) : uvec2(0);
        barrier();
        for (uint bin = lane; bin < bins; bin += TILE_THREADS) {
            uint left = bin % across * SPLAT_BIN, top = bin / across * SPLAT_BIN;
            for (uint k = 0; k < GROUP_WORDS && group * GROUP_WORDS + k < words; ++k) {
                uint bits = 0;
                for (uint i = 0; i < 32; ++i) {
                    uvec2 span = spans[32 * k + i];
                    if (touches(span.x, left) && touches(span.y, top)) bits |= 1u << i;
                }
                marks[bin * words + group * GROUP_WORDS + k] = bits;
            }
        }
    }
}
