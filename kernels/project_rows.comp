#version 450
#extension GL_GOOGLE_include_directive : require

// Fuses the rows of the change's inverse transform with `project`.

#define COLUMNS 0u
#include "alias.glsl"
#include "half.glsl"
#include "trig.glsl"
#define ANGLES_ID 20
#include "binary_angle.glsl"
#define MORE float gain, momentum, bound; uint step_count;
#include "change_rows.glsl"

// The phases that made the field. This is the buffer `phases` itself if nothing is quantized.
MAY_ALIAS layout(std430, binding = 2) readonly buffer Shown { uint shown[]; };
MAY_ALIAS layout(std430, binding = 3) buffer Phases { uint phases[]; };
layout(std430, binding = 4) buffer Velocity { uint velocity[]; };

#include "project.glsl"
