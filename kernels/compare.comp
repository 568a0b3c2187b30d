#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// Replaces the image by the factor for the field, and sums the loss of each workgroup. In x, each workgroup takes
// COMPARE_SHARE pixels.

layout(local_size_x = SUM_WIDTH) in;
layout(std430, binding = 0) buffer Image { float image[]; };
layout(std430, binding = 1) readonly buffer Target { float target_image[]; };
layout(std430, binding = 2) writeonly buffer Losses { float losses[]; };
layout(push_constant) uniform Args {
    uint count, mode;
    float exposure, weight, low, limit;
};

shared float parts[SUM_WIDTH];

void main() {
    float sum = 0.0;
    uint first = gl_WorkGroupID.x * COMPARE_SHARE;
    for (uint i = first + gl_LocalInvocationID.x; i < min(first + COMPARE_SHARE, count); i += SUM_WIDTH) {
        float seen = exposure * image[i];
        float wanted = target_image[i];
        float rest = seen - wanted;
        float factor;
        if (mode == COMPARE_PROJECTION) {
            factor = min(sqrt((wanted + low) / (seen + low)), limit) - 1.0;
        } else if (mode == COMPARE_INTENSITY) {
            factor = weight * rest;
        } else {
            seen = sqrt(seen + low);
            wanted = sqrt(wanted + low);
            rest = seen - wanted;
            factor = 0.5 * weight * (1.0 - wanted / seen);
        }
        image[i] = factor;
        sum += rest * rest;
    }
    parts[gl_LocalInvocationID.x] = sum;
    for (uint half_size = SUM_WIDTH / 2; half_size > 0; half_size /= 2) {
        barrier();
        if (gl_LocalInvocationID.x < half_size) {
            parts[gl_LocalInvocationID.x] += parts[gl_LocalInvocationID.x + half_size];
        }
    }
    if (gl_LocalInvocationID.x == 0) losses[gl_WorkGroupID.x] = parts[0];
}
