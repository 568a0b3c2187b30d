// Transforms of A * B * C values in registers: natural order in, order of `place` out.
//
// Included once per radix, after fft_lines.glsl, with names given by macros: A, B, C (specialisation constants, each 1,
// 2, 4, 8 or an odd prime, so that all loops unroll), WAVES (exp(-i 2 pi k / (A B C)), up to
// half a turn: fft_roots.glsl), and the names of the functions. All is folded when the pipeline is made.

vec2 ROOT(uint k) {
    const uint radix = A * B * C;
    uint turn = 2 * k > radix ? radix - k : k;
    return 2 * k > radix ? vec2(WAVES[turn].x, -WAVES[turn].y) : WAVES[turn];
}

ODD_PRIME(PRIME_A, A, (A * B * C), ROOT)
ODD_PRIME(PRIME_B, B, (A * B * C), ROOT)
ODD_PRIME(PRIME_C, C, (A * B * C), ROOT)

// Turns v[i] by k / (A B C) of a circle.
void TURN(uint i, uint k) {
    const uint radix = A * B * C;
    vec2 x = v[i];
    if (k == 0) return;
    if (4 * k == radix) v[i] = turned(x);
    else if (2 * k == radix) v[i] = -x;
    else if (4 * k == 3 * radix) v[i] = -turned(x);
    else if (8 * k == radix) v[i] = HALF_ROOT * (x + turned(x));
    else if (8 * k == 3 * radix) v[i] = HALF_ROOT * (turned(x) - x);
    else v[i] = times(x, ROOT(k));
}

// Where BUTTERFLY() leaves output k.
uint PLACE(uint k) {
    uint inner = k / A;
    return k % A * (B * C) + inner % B * C + inner / B;
}

void BUTTERFLY() {
    [[unroll]] for (uint j = 0; j < B * C; ++j) {
        LINE(A, PRIME_A, j, B * C)
        [[unroll]] for (uint k = 1; k < A; ++k) TURN(k * (B * C) + j, j * k);
    }
    [[unroll]] for (uint a = 0; a < A; ++a) {
        [[unroll]] for (uint j = 0; j < C; ++j) {
            LINE(B, PRIME_B, a * (B * C) + j, C)
            [[unroll]] for (uint k = 1; k < B; ++k) TURN(a * (B * C) + k * C + j, A * j * k);
        }
        [[unroll]] for (uint b = 0; b < B; ++b) {
            LINE(C, PRIME_C, a * (B * C) + b * C, 1)
        }
    }
}
