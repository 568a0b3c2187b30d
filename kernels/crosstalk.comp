#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// wave *= along_y * along_x. x: column, y: row (strided), z: pair.

layout(local_size_x = WIDTH) in;
// Along y, then along x.
layout(std430, binding = 0) readonly buffer Crosstalk { vec2 along[]; };
layout(std430, binding = 1) buffer Wave { vec2 wave[]; };
layout(push_constant) uniform Args {
    uint height, width;
    // Sub-frames, and values from one frame to the next.
    uint frames, wave_stride;
};

vec2 times(vec2 a, vec2 b) { return vec2(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x); }

void main() {
    uint x = gl_GlobalInvocationID.x;
    if (x >= width) return;
    vec2 along_x = along[height + x];
    for (uint y = gl_WorkGroupID.y; y < height; y += gl_NumWorkGroups.y) {
        uint at = gl_GlobalInvocationID.z * wave_stride + y * width + x;
        wave[at] = times(wave[at], times(along[y], along_x));
    }
}
