#version 450
#extension GL_GOOGLE_include_directive : require

// Processes row x of the images of the pupils z, in all sub-frames. It fuses the rows of the window's inverse
// transform, `intensity`, `compare`, `apply_factor`, and the rows of the forward transform. It reads and writes the
// columns in use, and stores no retinal field. All pupils have windows with the same number of columns. MODE selects a
// part of this work:
// LOOK computes and stores the intensity.
// SEE computes and stores the factor, and computes the loss of the row.
// TURN_BACK starts from the columns again, applies the stored factor, and computes the rows of the forward transform.
// WHOLE does everything at once. The row of all sub-frames stays in shared memory.

layout(constant_id = 21) const uint MODE = 0;
// KEPT is the number of rows in shared memory, one per sub-frame. PIXELS is the number of pixels of a row if the mode
// sums its image, otherwise 1. SHARES is the number of invocations if the mode computes losses, otherwise 1.
layout(constant_id = 22) const uint KEPT = 1;
layout(constant_id = 23) const uint PIXELS = 1;
layout(constant_id = 24) const uint SHARES = 1;
const uint LOOK = 0, SEE = 1, TURN_BACK = 2, WHOLE = 3;
const uint DOWN = 0, UP = 1;

#define COLUMNS 0u
#define AREAS KEPT
#define FROM_SHARED(way) (way == UP)
#define TO_SHARED(way) (way == DOWN)
#include "alias.glsl"
#include "half.glsl"
#include "fft_lines.glsl"

MAY_ALIAS layout(std430, binding = 0) buffer Window2 { COMPLEX window2[]; };
MAY_ALIAS layout(std430, binding = 0) buffer Window4 { COMPLEX2 window4[]; };
MAY_ALIAS layout(std430, binding = 2) buffer Image { float image[]; };
MAY_ALIAS layout(std430, binding = 3) readonly buffer Target { float target_image[]; };
MAY_ALIAS layout(std430, binding = 4) writeonly buffer Losses { float losses[]; };
#define PUPILS 5
#include "pupils.glsl"
layout(push_constant) uniform Args {
    uint columns, frames;
    // First value of each bound range.
    uint window_base, pixels_base, losses_base;
    uint members[BATCH];
};

// The intensities of the row, later its factors.
shared float factors[PIXELS];
shared float shares[SHARES];

uint pupil;
// Columns in use, and the index of this invocation's row.
uint first, used, origin;

uint invocation() { return gl_LocalInvocationID.y * X + gl_LocalInvocationID.x; }

// Returns pixel i of the row in area a.
vec2 seen_in(uint a, uint i) {
    if (PAIR == 0u) return shared2[a * SLOTS + i + i / FFT_FREE_SLOT];
    uint u = i / 2u;
    vec4 both = shared4[a * SLOTS + u + u / FFT_FREE_SLOT];
    return (i & 1u) == 0u ? both.xy : both.zw;
}

// Returns the index of pixel i of the row in an image.
uint pixel(uint i) { return pupils[pupil].pixels - pixels_base + gl_WorkGroupID.x * columns + i; }

float factor_at(uint i) { return MODE == TURN_BACK ? image[pixel(i)] : factors[i]; }

vec4 fetch4(uint way, uint i) {
    if (way == UP) {
        float a = factor_at(i), b = factor_at(i + 1u);
        return shared4[slot(i / 2u)] * vec4(a, a, b, b);
    }
    return in_use(i, first, used) ? LOAD2(window4[(origin + i) / 2u]) : vec4(0.0);
}
vec2 fetch2(uint way, uint i) {
    if (way == UP) return shared2[slot(i)] * factor_at(i);
    return in_use(i, first, used) ? LOAD(window2[origin + i]) : vec2(0.0);
}
void put4(uint way, uint i, vec4 z) {
    if (way == DOWN) shared4[slot(i / 2u)] = z;
    else if (in_use(i, first, used)) window4[(origin + i) / 2u] = STORE2(z);
}
void put2(uint way, uint i, vec2 z) {
    if (way == DOWN) shared2[slot(i)] = z;
    else if (in_use(i, first, used)) window2[origin + i] = STORE(z);
}

// Returns the factor and adds the loss to `sum`, as in compare.comp.
float compared(float intensity, float wanted, inout float sum) {
    float low = pupils[pupil].low, weight = pupils[pupil].weight;
    float seen = pupils[pupil].exposure * intensity;
    float rest = seen - wanted, factor;
    if (pupils[pupil].mode == COMPARE_PROJECTION) {
        factor = min(sqrt((wanted + low) / (seen + low)), pupils[pupil].limit) - 1.0;
    } else if (pupils[pupil].mode == COMPARE_INTENSITY) {
        factor = weight * rest;
    } else {
        seen = sqrt(seen + low);
        wanted = sqrt(wanted + low);
        rest = seen - wanted;
        factor = 0.5 * weight * (1.0 - wanted / seen);
    }
    sum += rest * rest;
    return factor;
}

// Selects the row of a sub-frame in an area of shared memory for this invocation.
void take(uint frame, uint in_area) {
    area = in_area;
    present = frame < frames;
    origin = pupils[pupil].window - window_base + frame * pupils[pupil].window_stride + gl_WorkGroupID.x * columns;
}

void main() {
    n = columns;
    pupil = members[gl_WorkGroupID.z];
    // Some windows have fewer rows.
    if (gl_WorkGroupID.x >= pupils[pupil].rows) return;
    first = pupils[pupil].first;
    used = pupils[pupil].used;
    if (MODE == TURN_BACK) {
        take(gl_WorkGroupID.y * LINES + gl_LocalInvocationID.y, gl_LocalInvocationID.y);
        transform(DOWN, true);
        transform(UP, false);
        return;
    }
    // Sub-frames that are in shared memory at once.
    const uint held = MODE == WHOLE ? KEPT : LINES;
    for (uint base = 0u; base < frames; base += held) {
        for (uint at = 0u; at < held; at += LINES) {
            take(base + at + gl_LocalInvocationID.y, at + gl_LocalInvocationID.y);
            transform(DOWN, true);
        }
        for (uint i = invocation(); i < n; i += X * Y) {
            float sum = base == 0u ? 0.0 : factors[i];
            for (uint a = 0u; a < min(held, frames - base); a++) {
                vec2 z = seen_in(a, i);
                sum += pupils[pupil].gain * dot(z, z);
            }
            factors[i] = sum;
        }
        barrier();
    }
    float loss = 0.0;
    for (uint i = invocation(); i < n; i += X * Y) {
        uint at = pixel(i);
        float value = factors[i];
        if (MODE != LOOK) value = compared(value, target_image[at], loss);
        if (MODE == WHOLE) factors[i] = value;
        else image[at] = value;
    }
    if (MODE == LOOK) return;
    shares[invocation()] = loss;
    for (uint count = X * Y; count > 1u;) {
        uint rest = (count + 1u) / 2u;
        barrier();
        if (invocation() + rest < count) shares[invocation()] += shares[invocation() + rest];
        count = rest;
    }
    barrier();
    if (invocation() == 0u) losses[pupils[pupil].losses - losses_base + gl_WorkGroupID.x] = shares[0];
    if (MODE == WHOLE) {
        for (uint at = 0u; at < KEPT; at += LINES) {
            take(at + gl_LocalInvocationID.y, at + gl_LocalInvocationID.y);
            transform(UP, false);
        }
    }
}
