// Moves phases by the share of the change that they can follow. The including shader has the buffers `shown`, `phases`
// and `velocity`, and the arguments `gain`, `momentum`, `bound` and `step_count`.

#ifdef HALF

// Returns the threshold of a pixel in this step.
uint threshold(uint pixel) {
    uint x = pixel;
    x = (x ^ (x >> 16)) * 0x7feb352du;
    x = (x ^ (x >> 15)) * 0x846ca68bu;
    return (x ^ (x >> 16)) + step_count * 0x9e3779b9u;
}

// Returns the angle after a turn by `by` radians. It wraps by whole turns, or stays within 0 .. `bound` of the drive.
uint angle_turned(uint angle, float by, uint threshold) {
    precise float turns = by * PER_TURN;
    if (bound > 0.0) {
        precise float most = roundEven(bound * PER_TURN * 65536.0);
        precise float to = float(angle) + floor(turns * 65536.0 + float(threshold >> 8) * ANGLE_PART);
        return uint(min(max(to, 0.0), most));
    }
    precise float rest = turns - roundEven(turns);
    precise float units = floor(rest * 65536.0 + float(threshold >> 8) * ANGLE_PART);
    return (angle + uint(int(units))) & 0xffffu;
}

// Returns the bits of `x`, rounded up or down to a half as the threshold decides.
uint velocity_bits(float x, uint threshold) {
    x = clamp(x, -65504.0, 65504.0);
    uint bits = floatBitsToUint(x), size = bits & 0x7fffffffu;
    if (size < 0x38800000u) return half_bits(x);
    return min((size + (threshold & 0x1fffu) - 0x38000000u) >> 13, 0x7bffu) | ((bits >> 16) & 0x8000u);
}

// Returns a binary angle and its velocity after the step, for pixel `at` of the sub-frame.
uvec2 angle_moved(uvec2 was, vec2 du, uint at) {
    vec2 u = cos_sin(angle_value(was.x));
    float turn = gain * (u.x * du.y - u.y * du.x);
    float v = momentum * half_value(was.y) + turn;
    uint by = threshold(at);
    return uvec2(angle_turned(was.x, momentum * v + turn, by), velocity_bits(v, by));
}

#endif

// Moves pixel `at` of the sub-frame that starts at `base`.
void move(uint base, uint at, vec2 du) {
    uint i = base + at;
#ifdef HALF
    if (ANGLES == 1u) {
        // The other half of the word may belong to another invocation.
        uint word = i / 2u, shift = 16u * (i & 1u);
        uvec2 was = (uvec2(phases[word], velocity[word]) >> shift) & 0xffffu;
        uvec2 differs = (was ^ angle_moved(was, du, at)) << shift;
        atomicXor(phases[word], differs.x);
        atomicXor(velocity[word], differs.y);
        return;
    }
#endif
    float phase = uintBitsToFloat(phases[i]);
    vec2 u = cos_sin(uintBitsToFloat(shown[i]));
    float turn = gain * (u.x * du.y - u.y * du.x);
    float v = momentum * uintBitsToFloat(velocity[i]) + turn;
    velocity[i] = floatBitsToUint(v);
    phases[i] = floatBitsToUint(turned(phase, momentum * v + turn, bound));
}

// Moves this pixel and the next one.
void move_both(uint base, uint at, vec4 du) {
#ifdef HALF
    uint i = base + at;
    if (ANGLES == 1u && (i & 1u) == 0u) {
        uint word = i / 2u, p = phases[word], w = velocity[word];
        uvec2 a = angle_moved(uvec2(p, w) & 0xffffu, du.xy, at);
        uvec2 b = angle_moved(uvec2(p, w) >> 16, du.zw, at + 1u);
        phases[word] = a.x | (b.x << 16);
        velocity[word] = a.y | (b.y << 16);
        return;
    }
#endif
    move(base, at, du.xy);
    move(base, at + 1u, du.zw);
}
