#version 450
#extension GL_GOOGLE_include_directive : require
#include "alias.glsl"
#include "half.glsl"
#include "trig.glsl"
#define ANGLES_ID 0
#include "binary_angle.glsl"
#include "drives.glsl"

// Fuses the transposes of crosstalk along both axes and of lag with `drive_adjoint` and `project`. It does not store
// the change of the field between them.

#define BACK
#define MORE float gain, momentum, bound; uint step_count;
#include "tiles.glsl"

layout(std430, binding = 1) readonly buffer Tables { float level[]; };
// The phases that made the field. This is the buffer `phases` itself if nothing is quantized.
MAY_ALIAS layout(std430, binding = 2) readonly buffer Shown { uint shown[]; };
layout(std430, binding = 3) readonly buffer Wave { DRIVES wave[]; };
MAY_ALIAS layout(std430, binding = 4) buffer Phases { uint phases[]; };
layout(std430, binding = 5) buffer Velocity { uint velocity[]; };

#include "project.glsl"

float coming(uint frame, uint pixel) { return DRIVE_AT(wave, frame * wave_stride + pixel); }

// Carries the gradient back through the look-up table, to the change of a field of the phases themselves.
vec2 change(uint frame, uint pixel, float tau) {
    vec2 t = cos_sin(wrapped(PHASE_AT(shown, frame * phases_stride + pixel)));
    float turn = (level[pixel] + (bend_sin * t.x + bend_cos * t.y)) * tau;
    return vec2(-turn * t.y, turn * t.x);
}
void put(uint frame, uint pixel, float tau) { move(frame * phases_stride, pixel, change(frame, pixel, tau)); }
void put_both(uint frame, uint pixel, vec2 tau) {
    move_both(frame * phases_stride, pixel, vec4(change(frame, pixel, tau.x), change(frame, pixel + 1u, tau.y)));
}
