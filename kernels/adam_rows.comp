#version 450
#extension GL_GOOGLE_include_directive : require

// Fuses the rows of the change's inverse transform with `adam`.

#define COLUMNS 0u
#include "alias.glsl"
#include "half.glsl"
#include "trig.glsl"
#define MORE float rate, beta1, beta2, correct1, correct2, epsilon;
#include "change_rows.glsl"

// The phases that made the field. This is the buffer `phases` itself if nothing is quantized.
MAY_ALIAS layout(std430, binding = 2) readonly buffer Shown { float shown[]; };
MAY_ALIAS layout(std430, binding = 3) buffer Phases { float phases[]; };
layout(std430, binding = 4) buffer First { float first_moment[]; };
layout(std430, binding = 5) buffer Second { float second_moment[]; };

#include "adam.glsl"

void move(uint base, uint at, vec2 du) { adam(base + at, du); }
void move_both(uint base, uint at, vec4 du) {
    adam(base + at, du.xy);
    adam(base + at + 1u, du.zw);
}
