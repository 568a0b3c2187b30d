// Applies the first-order lag over the sub-frames of a repeating set. With BACK it is the transpose. x is the pixel
// (strided).

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) buffer Wave { DRIVES wave[]; };
layout(push_constant) uniform Args {
    uint count, frames;
    // The factor (1 - h) / (1 - h^frames), and h.
    float settled, lag;
    // Number of values from one sub-frame to the next.
    uint stride;
};

#ifdef BACK
uint ordered(uint i) { return frames - 1 - i; }
#else
uint ordered(uint i) { return i; }
#endif

void main() {
    for (uint k = gl_GlobalInvocationID.x; k < count; k += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        precise float state = 0.0;
        for (uint i = 0; i < frames; i++) state = state * lag + DRIVE_AT(wave, ordered(i) * stride + k);
        state *= settled;
        for (uint i = 0; i < frames; i++) {
            uint at = ordered(i) * stride + k;
            state = (1.0 - lag) * DRIVE_AT(wave, at) + lag * state;
            PUT_DRIVE(wave, at, state);
        }
    }
}
