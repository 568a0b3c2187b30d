// Sine, cosine and wrapping of phases: the arithmetic of trig.rs. Vulkan's own sine is good to 2^-11 only.

const float HALF_PI_1 = 1.5703125;
const float HALF_PI_2 = 4.83751297e-4;
const float HALF_PI_3 = 7.5497899e-8;

// Cosine and sine of x radians, |x| < 10^4.
vec2 cos_sin(float x) {
    precise float n = roundEven(x * 0.636619772);
    int quadrant = int(n);
    precise float r = ((x - n * HALF_PI_1) - n * HALF_PI_2) - n * HALF_PI_3;
    precise float r2 = r * r;
    precise float s = r + r * r2 * (-1.6666655e-1 + r2 * (8.332161e-3 + r2 * -1.9515296e-4));
    precise float c = 1.0 - 0.5 * r2 + r2 * r2 * (4.1666646e-2 + r2 * (-1.3887316e-3 + r2 * 2.4433157e-5));
    vec2 turned = (quadrant & 1) == 0 ? vec2(c, s) : vec2(s, c);
    return vec2(((quadrant + 1) & 2) == 0 ? turned.x : -turned.x, (quadrant & 2) == 0 ? turned.y : -turned.y);
}

// Brings a phase into -pi .. pi by whole turns, |x| < 10^4.
float wrap(float x) {
    precise float n = roundEven(x * 0.159154943);
    precise float y = (x - n * 6.28125) - n * 1.9353072e-3;
    return y;
}
