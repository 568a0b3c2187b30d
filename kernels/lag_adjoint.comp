#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "half.glsl"
#include "drives.glsl"
#define BACK
#include "lag.glsl"
