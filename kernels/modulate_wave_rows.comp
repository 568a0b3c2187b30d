#version 450
#extension GL_GOOGLE_include_directive : require

// Fuses `modulate_wave`, of one sub-pixel, with the rows of the field's transform.

#define COLUMNS 0u
#include "alias.glsl"
#include "half.glsl"
#include "trig.glsl"
#include "drives.glsl"
#include "field_rows.glsl"

layout(std430, binding = 0) readonly buffer Wave { DRIVES wave[]; };
// Level, amplitude, real and imaginary part of the rest.
layout(std430, binding = 3) readonly buffer Tables { float tables[]; };

vec2 value_at(uint base, uint pixel) {
    uint pixels = height * width;
    vec2 rest = vec2(tables[2u * pixels + pixel], tables[3u * pixels + pixel]);
    return scale * (tables[pixels + pixel] * cos_sin(DRIVE_AT(wave, base + pixel)) + rest);
}
