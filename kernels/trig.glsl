// Sine, cosine and wrapping of phases, with the arithmetic of trig.rs. Vulkan guarantees 2^-11 only for its own sine.

#include "constants.glsl"

// Returns cosine and sine of x radians, |x| < 10^4.
vec2 cos_sin(float x) {
    precise float n = roundEven(x * TWO_OVER_PI);
    int quadrant = int(n);
    precise float r = ((x - n * HALF_PI_1) - n * HALF_PI_2) - n * HALF_PI_3;
    precise float r2 = r * r;
    precise float s = r + r * r2 * (SIN_3 + r2 * (SIN_5 + r2 * SIN_7));
    precise float c = 1.0 - 0.5 * r2 + r2 * r2 * (COS_4 + r2 * (COS_6 + r2 * COS_8));
    vec2 turned = (quadrant & 1) == 0 ? vec2(c, s) : vec2(s, c);
    return vec2(((quadrant + 1) & 2) == 0 ? turned.x : -turned.x, (quadrant & 2) == 0 ? turned.y : -turned.y);
}

// Moves a phase into -pi .. pi by whole turns, |x| < 10^4.
float wrap(float x) {
    precise float n = roundEven(x * PER_TURN);
    precise float y = (x - n * TURN_1) - n * TURN_2;
    return y;
}

// Returns the drive of a phase, which whole turns bring into 0 .. 2 pi, |phase| < 10^4.
float wrapped(float phase) {
    precise float n = floor(phase * PER_TURN);
    precise float w = (phase - n * TURN_1) - n * TURN_2;
    return w;
}

// Returns the phase after a turn by `by`. It wraps by whole turns, or stays within 0 .. `bound` of the drive.
float turned(float phase, float by, float bound) {
    return bound > 0.0 ? wrap(min(max(wrapped(phase) + by, 0.0), bound)) : wrap(phase + by);
}
