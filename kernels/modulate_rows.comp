#version 450
#extension GL_GOOGLE_include_directive : require

// Fuses `modulate` with the rows of the field's transform.

#define COLUMNS 0u
#include "alias.glsl"
#include "half.glsl"
#include "trig.glsl"
#define ANGLES_ID 20
#include "binary_angle.glsl"
#include "field_rows.glsl"

layout(std430, binding = 0) readonly buffer Phases { uint phases[]; };

vec2 value_at(uint base, uint pixel) { return scale * cos_sin(PHASE_AT(phases, base + pixel)); }
