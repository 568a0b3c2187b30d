#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "relief.glsl"

// picture = disparities, then colors, of a frame of an application. Invalid values become 0. The state gets the first of
// them, and the ends of the disparities.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Samples { uint samples[]; };
layout(std430, binding = 1) readonly buffer Curve { float curve[]; };
layout(std430, binding = 2) writeonly buffer Picture { float picture[]; };
layout(std430, binding = 3) buffer State { uint state[]; };

layout(push_constant) uniform Args {
    uint pixels, channels, wanted_0, wanted_1, wanted_2, sample_kind, coded, depths;
    float per_dioptre;
};

#define SAMPLE_WORD(i) samples[i]
#define CURVE(i) curve[i]
#include "samples.glsl"

shared uint bad_light, bad_depth, low, high;

void main() {
    uint lane = gl_LocalInvocationID.x;
    if (lane == 0) {
        bad_light = bad_depth = low = 0xffffffffu;
        high = 0;
    }
    barrier();
    uint wanted[3] = uint[](wanted_0, wanted_1, wanted_2);
    for (uint p = gl_GlobalInvocationID.x; p < pixels; p += gl_NumWorkGroups.x * WIDTH) {
        for (uint k = 0; k < 3; ++k) {
            uint at = p * channels + wanted[k];
            uint bits = light_of_sample(at, sample_kind, coded);
            bool valid = is_light(bits);
            if (!valid) atomicMin(bad_light, at);
            picture[pixels + 3 * p + k] = valid ? abs(uintBitsToFloat(bits)) : 0.0;
        }
        uint bits = samples[depths + p];
        bool valid = (bits & 0x7fffffffu) <= floatBitsToUint(RELIEF_DEEPEST);
        if (!valid) atomicMin(bad_depth, p);
        precise float disparity = valid ? uintBitsToFloat(bits) * per_dioptre : 0.0;
        picture[p] = disparity;
        atomicMin(low, ordered(disparity));
        atomicMax(high, ordered(disparity));
    }
    barrier();
    if (lane == 0) {
        if (bad_light != 0xffffffffu) atomicMin(state[0], bad_light);
        if (bad_depth != 0xffffffffu) atomicMin(state[1], bad_depth);
        atomicMin(state[2], low);
        atomicMax(state[3], high);
    }
}
