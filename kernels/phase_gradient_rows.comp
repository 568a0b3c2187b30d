#version 450
#extension GL_GOOGLE_include_directive : require

// Fuses the rows of the change's inverse transform with `phase_gradient`, of one sub-pixel.

#define COLUMNS 0u
#include "alias.glsl"
#include "half.glsl"
#include "trig.glsl"
#include "drives.glsl"
#define MORE
#include "change_rows.glsl"

// Level, amplitude, real and imaginary part of the rest.
layout(std430, binding = 2) readonly buffer Tables { float tables[]; };
layout(std430, binding = 3) buffer Wave { DRIVES wave[]; };

float tau(uint base, uint at, vec2 du) {
    vec2 t = cos_sin(DRIVE_AT(wave, base + at));
    return tables[height * width + at] * (t.x * du.y - t.y * du.x);
}
void move(uint base, uint at, vec2 du) {
    float asked = tau(base, at, du);
    PUT_DRIVE(wave, base + at, asked);
}
void move_both(uint base, uint at, vec4 du) {
    if (((base + at) & 1u) == 1u) {
        move(base, at, du.xy);
        move(base, at + 1u, du.zw);
        return;
    }
    vec2 asked = vec2(tau(base, at, du.xy), tau(base, at + 1u, du.zw));
    PUT_DRIVES(wave, base + at, asked.x, asked.y);
}
