#include "constants.glsl"

// First-order lag over the sub-frames of a set that repeats, in pairs; with BACK transposed. x: point (strided).

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) buffer Wave { vec2 wave[]; };
layout(push_constant) uniform Args {
    uint count, frames;
    // (1 - h) / (1 - h^frames), and h.
    float settled, lag;
    uint wave_stride;
};

#ifdef BACK
uint ordered(uint i) { return frames - 1 - i; }
#else
uint ordered(uint i) { return i; }
#endif

void main() {
    for (uint k = gl_GlobalInvocationID.x; k < count; k += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        precise float state = 0.0;
        for (uint i = 0; i < frames; i++) {
            uint t = ordered(i);
            vec2 z = wave[t / 2 * wave_stride + k];
            state = state * lag + ((t & 1) == 0 ? z.x : z.y);
        }
        state *= settled;
        for (uint i = 0; i < frames; i++) {
            uint t = ordered(i), at = t / 2 * wave_stride + k;
            vec2 z = wave[at];
            state = (1.0 - lag) * ((t & 1) == 0 ? z.x : z.y) + lag * state;
            wave[at] = (t & 1) == 0 ? vec2(state, z.y) : vec2(z.x, state);
        }
    }
}
