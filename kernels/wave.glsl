// What the kernels between phases and field share: the look-up table's drive, and which half of a pair a sub-frame is.

#include "trig.glsl"

// The drive of a phase: brought into 0 .. 2 pi by whole turns, |phase| < 10^4.
float wrapped(float phase) {
    precise float n = floor(phase * PER_TURN);
    precise float w = (phase - n * TURN_1) - n * TURN_2;
    return w;
}
