#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// Differences of contrast, filtered along columns, to the factor for the field, in place of the image; the loss is summed per
// workgroup. x: COMPARE_SHARE pixels per workgroup.

layout(local_size_x = SUM_WIDTH) in;
layout(std430, binding = 0) readonly buffer Weights { float weights[]; };
layout(std430, binding = 1) readonly buffer Contrast { float contrast[]; };
layout(std430, binding = 2) readonly buffer Target { float target_image[]; };
layout(std430, binding = 3) buffer Image { float image[]; };
layout(std430, binding = 4) writeonly buffer Losses { float losses[]; };
#include "contrast.glsl"

shared float parts[SUM_WIDTH];

void main() {
    float sum = 0.0;
    uint first = gl_WorkGroupID.x * COMPARE_SHARE;
    for (uint i = first + gl_LocalInvocationID.x; i < min(first + COMPARE_SHARE, rows * columns); i += SUM_WIDTH) {
        uint y = i / columns, x = i - y * columns;
        float resolved = weights[0] * contrast[i];
        for (uint t = 1; t <= reach_y; t++) {
            resolved += weights[t] * (contrast[(y + rows - t) % rows * columns + x] +
                                      contrast[(y + t) % rows * columns + x]);
        }
        if (has_gaze()) {
            float share = sharp(y, x);
            resolved = share * difference(image[i], target_image[i]) + sqrt(1.0 - share) * resolved;
        }
        float wanted = target_image[i], luminance = wanted + dark;
        sum += difference(image[i], wanted) * resolved;
        if (mode == COMPARE_PROJECTION) {
            float seen = exposure * image[i];
            float there = max(seen - luminance * resolved, 0.0);
            image[i] = min(sqrt((there + low) / (seen + low)), limit) - 1.0;
        } else {
            image[i] = weight * resolved / luminance;
        }
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
