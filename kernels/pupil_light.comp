#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// light (+)= sum over views of weight * view, on the SLM's pixels. This is the light that a pupil sees in focus. The
// sums are whole numbers, so every device has the same result. x is the pixel (strided).

layout(local_size_x = WIDTH) in;
// Two u16 per word, with the first one in the low bits.
layout(std430, binding = 0) readonly buffer Views { uint views[]; };
// A view and its weight.
layout(std430, binding = 1) readonly buffer Shares { uvec2 shares[]; };
layout(std430, binding = 2) buffer Light { uint light[]; };

layout(push_constant) uniform Args {
    uint height, width, line, first, stride, from, begin, end, adds;
};

void main() {
    uint step_size = gl_NumWorkGroups.x * WIDTH;
    for (uint i = gl_GlobalInvocationID.x; i < height * width; i += step_size) {
        uint at = first + i / width * line + i % width;
        uint sum = adds == 0 ? 0 : light[i];
        for (uint k = begin; k < end; ++k) {
            uint value = at + (shares[k].x - from) * stride;
            sum += shares[k].y * ((views[value >> 1] >> ((value & 1u) << 4)) & 0xffffu);
        }
        light[i] = sum;
    }
}
