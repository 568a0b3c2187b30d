#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// frame = the colors and the dioptres of canvas as live input takes them. found = 1 if content was too near.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Canvas { vec4 canvas[]; };
layout(std430, binding = 1) writeonly buffer Frame { uint frame[]; };
layout(std430, binding = 2) buffer Found { uint found; };

layout(push_constant) uniform Args {
    uint pixels, colors, light, depth;
    float nearest;
};

// Returns the bits of a value from 0 to `most`. Compares bits, because a device may compare a NaN in any way.
uint limited(float value, float most) {
    uint bits = floatBitsToUint(value);
    if (bits <= floatBitsToUint(most)) return bits;
    return bits > 0x7f800000u ? 0u : floatBitsToUint(most);
}

void main() {
    uint step_size = gl_NumWorkGroups.x * WIDTH;
    uint channels = bitCount(colors);
    for (uint pixel = gl_GlobalInvocationID.x; pixel < pixels; pixel += step_size) {
        vec4 composed = canvas[pixel];
        uint to = light + channels * pixel;
        for (uint color = 0; color < 3; ++color) {
            if ((colors >> color & 1u) != 0) frame[to++] = limited(composed[color], COMPOSE_BRIGHTEST);
        }
        uint dioptres = limited(composed.a, COMPOSE_NEAREST);
        if (uintBitsToFloat(dioptres) > nearest) {
            dioptres = floatBitsToUint(nearest);
            atomicOr(found, 1u);
        }
        frame[depth + pixel] = dioptres;
    }
}
