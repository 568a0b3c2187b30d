#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "half.glsl"
#include "drives.glsl"
#include "lag.glsl"
