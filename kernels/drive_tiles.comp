#version 450
#extension GL_GOOGLE_include_directive : require
#include "half.glsl"
#include "trig.glsl"
#define ANGLES_ID 0
#include "binary_angle.glsl"
#include "drives.glsl"

// Fuses `drive`, `lag`, and crosstalk along both axes.

#define MORE
#include "tiles.glsl"

layout(std430, binding = 1) readonly buffer Shown { uint shown[]; };
layout(std430, binding = 2) readonly buffer Tables { float level[]; };
layout(std430, binding = 3) DRIVES_OUT buffer Wave { DRIVES wave[]; };

#include "driven.glsl"

float coming(uint frame, uint pixel) { return driven(PHASE_AT(shown, frame * phases_stride + pixel), level[pixel]); }
void put(uint frame, uint pixel, float drive) { PUT_DRIVE(wave, frame * wave_stride + pixel, drive); }
void put_both(uint frame, uint pixel, vec2 drive) { PUT_DRIVES(wave, frame * wave_stride + pixel, drive.x, drive.y); }
