#version 450
#extension GL_GOOGLE_include_directive : require
#include "alias.glsl"
#include "constants.glsl"
#include "half.glsl"
#include "trig.glsl"

// Adam with wrapping, on the gradient 2 Im(G conj(u)). x: column, y: row (strided), z: frame.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Change { COMPLEX change[]; };
// The phases that made the field: the same buffer as `phases` where nothing is quantised.
MAY_ALIAS layout(std430, binding = 1) readonly buffer Shown { float shown[]; };
MAY_ALIAS layout(std430, binding = 2) buffer Phases { float phases[]; };
layout(std430, binding = 3) buffer First { float first[]; };
layout(std430, binding = 4) buffer Second { float second[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    float rate, beta1, beta2, correct1, correct2, epsilon;
    // Values from one frame to the next.
    uint change_stride, phases_stride;
};

void main() {
    uint x = gl_GlobalInvocationID.x;
    uint frame = gl_GlobalInvocationID.z;
    if (x >= width) return;
    for (uint y = gl_WorkGroupID.y; y < height; y += gl_NumWorkGroups.y) {
        uint at = frame * phases_stride + y * width + x;
        vec2 g = LOAD(change[frame * change_stride + (top + y) * grid_width + left + x]);
        float phase = phases[at];
        vec2 u = cos_sin(shown[at]);
        float gradient = 2.0 * (g.y * u.x - g.x * u.y);
        float m = beta1 * first[at] + (1.0 - beta1) * gradient;
        float v = beta2 * second[at] + (1.0 - beta2) * (gradient * gradient);
        first[at] = m;
        second[at] = v;
        phases[at] = wrap(phase - rate * (m * correct1) / (sqrt(v * correct2) + epsilon));
    }
}
