#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "relief.glsl"

// marks = the levels of disparity of each block. The first word has the surface in front with its fringe, and the second
// one has the hidden surface.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Front { float front[]; };
layout(std430, binding = 1) readonly buffer Fringe { float fringe[]; };
layout(std430, binding = 2) readonly buffer Hidden { float hidden[]; };
layout(std430, binding = 3) writeonly buffer Marks { uvec2 marks[]; };

layout(push_constant) uniform Args { RELIEF_ARGS RELIEF_LEVEL_ARGS };

uint bit_of(float value) { return value > RELIEF_ABSENT ? 1u << LEVEL_OF(value) : 0u; }

void main() {
    ivec2 size = RELIEF_SIZE;
    ivec2 blocks = (size + RELIEF_SIDE - 1) / RELIEF_SIDE;
    uint count = uint(blocks.x * blocks.y);
    for (uint block = gl_GlobalInvocationID.x; block < count; block += gl_NumWorkGroups.x * WIDTH) {
        ivec2 corner = RELIEF_SIDE * place_of(block, blocks), end = min(corner + RELIEF_SIDE, size);
        uvec2 words = uvec2(0);
        for (int y = corner.y; y < end.y; ++y) {
            for (int x = corner.x; x < end.x; ++x) {
                uint p = pixel_of(ivec2(x, y), size);
                words |= uvec2(bit_of(front[p]) | bit_of(fringe[p]), bit_of(hidden[p]));
            }
        }
        marks[block] = words;
    }
}
