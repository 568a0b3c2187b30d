#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require

// The rows of the change's inverse transform and `turn`, of one sub-pixel.

#define COLUMNS 0u
#include "alias.glsl"
#include "constants.glsl"
#include "half.glsl"
#include "trig.glsl"
#include "fft_lines.glsl"
#define MORE
#include "change_rows.glsl"

// Level, amplitude, real and imaginary part of the rest.
layout(std430, binding = 2) readonly buffer Tables { float tables[]; };
layout(std430, binding = 3) buffer Wave { float wave[]; };

void move(uint base, uint at, vec2 du) {
    vec2 t = cos_sin(wave[base + at]);
    wave[base + at] = tables[height * width + at] * (t.x * du.y - t.y * du.x);
}
void move_both(uint base, uint at, vec4 du) {
    move(base, at, du.xy);
    move(base, at + 1u, du.zw);
}
