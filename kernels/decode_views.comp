#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// views = samples of one color / scale, two u16 in a word. Each view (y) and workgroup (x) also stores sums of its
// light. They are light, light^2, light^3, the brightest value, and the first pixel without valid light.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Samples { uint samples[]; };
layout(std430, binding = 1) readonly buffer Curve { float curve[]; };
layout(std430, binding = 2) writeonly buffer Views { uint views[]; };
layout(std430, binding = 3) writeonly buffer Sums { uint sums[]; };

layout(push_constant) uniform Args {
    uint pixels, channels, channel, sample_kind, coded, first, stride;
    float scale;
};

shared vec4 parts[WIDTH];
shared uint wrong[WIDTH];

#define SAMPLE_WORD(i) samples[i]
#define CURVE(i) curve[i]
#include "samples.glsl"

// Returns the bits of a pixel's light.
uint light(uint view, uint pixel) {
    return light_of_sample(((first + view) * pixels + pixel) * channels + channel, sample_kind, coded);
}

void main() {
    uint view = gl_WorkGroupID.y;
    vec4 sum = vec4(0.0);
    uint bad = 0xffffffffu;
    uint step_size = gl_NumWorkGroups.x * WIDTH;
    for (uint word = gl_GlobalInvocationID.x; word < (pixels + 1) / 2; word += step_size) {
        uint stored = 0;
        for (uint i = 0; i < 2; ++i) {
            uint pixel = 2 * word + i;
            if (pixel >= pixels) break;
            uint bits = light(view, pixel);
            if (!is_light(bits)) bad = min(bad, pixel);
            float value = is_light(bits) ? abs(uintBitsToFloat(bits)) : 0.0;
            float square = value * value;
            sum += vec4(value, square, square * value, 0.0);
            sum.w = max(sum.w, value);
            if (scale > 0.0) stored |= min(uint(value / scale * 65535.0 + 0.5), 0xffffu) << (16 * i);
        }
        if (scale > 0.0) views[view * (stride / 2) + word] = stored;
    }
    uint lane = gl_LocalInvocationID.x;
    parts[lane] = sum;
    wrong[lane] = bad;
    for (uint half_size = WIDTH / 2; half_size > 0; half_size /= 2) {
        barrier();
        if (lane < half_size) {
            vec4 other = parts[lane + half_size];
            parts[lane] = vec4(parts[lane].xyz + other.xyz, max(parts[lane].w, other.w));
            wrong[lane] = min(wrong[lane], wrong[lane + half_size]);
        }
    }
    if (lane == 0) {
        uint at = (view * gl_NumWorkGroups.x + gl_WorkGroupID.x) * DECODE_SUMS;
        for (uint i = 0; i < 4; ++i) sums[at + i] = floatBitsToUint(parts[0][i]);
        sums[at + 4] = wrong[0];
    }
}
