// Returns the phase that a drive gives, with the arguments of the including shader.

float driven(float phase, float level) {
    float w = wrapped(phase);
    precise float value = level * w;
    if (bend_sin != 0.0 || bend_cos != 0.0) {
        vec2 t = cos_sin(w);
        value += bend_sin * t.y + bend_cos * (1.0 - t.x);
    }
    return value;
}
