#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "pair.glsl"

// Sums <I, T>, <I, I> and <T, T> over image I and target T after 2 x 2 averaging, as pairs of float32 per workgroup.
// Pairs are necessary because the squared error s^2 <I, I> - 2 s <I, T> + <T, T> is a small difference of large sums.
// In x, each workgroup takes EXPOSURE_SHARE pixels.

layout(local_size_x = SUM_WIDTH) in;
layout(std430, binding = 0) readonly buffer Image { float image[]; };
layout(std430, binding = 1) readonly buffer Target { float target_image[]; };
layout(std430, binding = 2) writeonly buffer Sums { float sums[]; };
layout(push_constant) uniform Args {
    uint height, width, pitch, top, left;
};

shared vec2 parts[3][SUM_WIDTH];

void main() {
    bool pools = height >= 2 && width >= 2;
    uint step_size = pools ? 2 : 1;
    uint rows = height / step_size, columns = width / step_size;
    vec2 products[3] = vec2[3](vec2(0.0), vec2(0.0), vec2(0.0));
    uint first = gl_WorkGroupID.x * EXPOSURE_SHARE, end = min(first + EXPOSURE_SHARE, rows * columns);
    for (uint i = first + gl_LocalInvocationID.x; i < end; i += SUM_WIDTH) {
        uint at = (top + step_size * (i / columns)) * pitch + left + step_size * (i % columns);
        precise float seen = image[at];
        precise float wanted = target_image[at];
        if (pools) {
            uint below = at + pitch;
            seen = 0.25 * (((seen + image[at + 1]) + image[below]) + image[below + 1]);
            wanted = 0.25 * (((wanted + target_image[at + 1]) + target_image[below]) + target_image[below + 1]);
        }
        products[0] = pair_add(products[0], pair_product(seen, wanted));
        products[1] = pair_add(products[1], pair_product(seen, seen));
        products[2] = pair_add(products[2], pair_product(wanted, wanted));
    }
    uint me = gl_LocalInvocationID.x;
    for (uint k = 0; k < 3; ++k) parts[k][me] = products[k];
    for (uint half_size = SUM_WIDTH / 2; half_size > 0; half_size /= 2) {
        barrier();
        if (me < half_size) {
            for (uint k = 0; k < 3; ++k) parts[k][me] = pair_add(parts[k][me], parts[k][me + half_size]);
        }
    }
    if (me == 0) {
        for (uint k = 0; k < 3; ++k) {
            sums[EXPOSURE_PART * gl_WorkGroupID.x + 2 * k] = parts[k][0].x;
            sums[EXPOSURE_PART * gl_WorkGroupID.x + 2 * k + 1] = parts[k][0].y;
        }
    }
}
