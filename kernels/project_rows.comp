#version 450
#extension GL_GOOGLE_include_directive : require

// The rows of the change's inverse transform and `project`.

#define COLUMNS 0u
#include "alias.glsl"
#include "half.glsl"
#include "trig.glsl"
#define ANGLES_ID 20
#include "binary_angle.glsl"
#define MORE float gain, momentum, bound; uint step_count;
#include "change_rows.glsl"

// The phases that made the field: the same buffer as `phases` where nothing is quantised.
MAY_ALIAS layout(std430, binding = 2) readonly buffer Shown { uint shown[]; };
MAY_ALIAS layout(std430, binding = 3) buffer Phases { uint phases[]; };
layout(std430, binding = 4) buffer Velocity { uint velocity[]; };

#include "project.glsl"
