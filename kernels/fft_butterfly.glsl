// Transforms of A * B * C values in registers, forward, natural order in, order of `place` out.
//
// The shader that includes this declares A, B and C as specialisation constants, so that all loops unroll and all
// indices of v are known when the pipeline is made, and `root(k)` = exp(-i 2 pi k / (A B C)), the same for all
// invocations. Each of A, B, C is 1, 2, 4, 8 or an odd prime.

const uint RADIX = A * B * C;
vec2 v[RADIX];

vec2 times(vec2 a, vec2 b) { return vec2(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x); }

// Times -i.
vec2 turned(vec2 a) { return vec2(a.y, -a.x); }

const float HALF_ROOT = 0.70710678118654752;

void pair(uint i, uint j) {
    vec2 sum = v[i] + v[j];
    v[j] = v[i] - v[j];
    v[i] = sum;
}

void four(uint i, uint j, uint k, uint l) {
    pair(i, k);
    pair(j, l);
    vec2 odd = turned(v[l]), even = v[k], most = v[j];
    v[j] = even + odd;
    v[l] = even - odd;
    v[k] = v[i] - most;
    v[i] += most;
}

void eight(uint at, uint by) {
    four(at, at + 2 * by, at + 4 * by, at + 6 * by);
    four(at + by, at + 3 * by, at + 5 * by, at + 7 * by);
    // Even half in 0 2 4 6, odd half in 1 3 5 7, each in order.
    vec2 a = v[at + by], b = v[at + 3 * by], c = v[at + 5 * by], d = v[at + 7 * by];
    b = HALF_ROOT * (b + turned(b));
    c = turned(c);
    d = HALF_ROOT * (turned(d) - d);
    vec2 p = v[at], q = v[at + 2 * by], r = v[at + 4 * by], s = v[at + 6 * by];
    v[at] = p + a;
    v[at + by] = q + b;
    v[at + 2 * by] = r + c;
    v[at + 3 * by] = s + d;
    v[at + 4 * by] = p - a;
    v[at + 5 * by] = q - b;
    v[at + 6 * by] = r - c;
    v[at + 7 * by] = s - d;
}

void three(uint at, uint by) {
    vec2 sum = v[at + by] + v[at + 2 * by];
    vec2 odd = 0.86602540378443865 * turned(v[at + by] - v[at + 2 * by]);
    vec2 even = v[at] - 0.5 * sum;
    v[at] += sum;
    v[at + by] = even + odd;
    v[at + 2 * by] = even - odd;
}

void five(uint at, uint by) {
    const float c1 = 0.30901699437494742, c2 = -0.80901699437494742;
    const float s1 = 0.95105651629515357, s2 = 0.58778525229247313;
    vec2 p = v[at + by] + v[at + 4 * by], q = v[at + 2 * by] + v[at + 3 * by];
    vec2 m = turned(v[at + by] - v[at + 4 * by]), n = turned(v[at + 2 * by] - v[at + 3 * by]);
    vec2 even1 = v[at] + c1 * p + c2 * q, even2 = v[at] + c2 * p + c1 * q;
    vec2 odd1 = s1 * m + s2 * n, odd2 = s2 * m - s1 * n;
    v[at] += p + q;
    v[at + by] = even1 + odd1;
    v[at + 2 * by] = even2 + odd2;
    v[at + 3 * by] = even2 - odd2;
    v[at + 4 * by] = even1 - odd1;
}

// Any odd prime P: sums and differences of mirrored pairs.
#define ODD_PRIME(name, P)                                                                   \
    void name(uint at, uint by) {                                                            \
        vec2 sums[P / 2 + 1], differences[P / 2 + 1], waves[P / 2 + 1];                      \
        vec2 all = v[at];                                                                    \
        [[unroll]] for (uint j = 1; j <= P / 2; ++j) {                                       \
            sums[j] = v[at + j * by] + v[at + (P - j) * by];                                 \
            differences[j] = turned(v[at + j * by] - v[at + (P - j) * by]);                  \
            waves[j] = root(j * (RADIX / P));                                                \
            all += sums[j];                                                                  \
        }                                                                                    \
        [[unroll]] for (uint k = 1; k <= P / 2; ++k) {                                       \
            vec2 even = v[at], odd = vec2(0.0);                                              \
            [[unroll]] for (uint j = 1; j <= P / 2; ++j) {                                   \
                uint turn = j * k % P;                                                       \
                vec2 wave = waves[min(turn, P - turn)];                                      \
                even += wave.x * sums[j];                                                    \
                odd += (turn <= P / 2 ? -wave.y : wave.y) * differences[j];                  \
            }                                                                                \
            v[at + k * by] = even + odd;                                                     \
            v[at + (P - k) * by] = even - odd;                                               \
        }                                                                                    \
        v[at] = all;                                                                         \
    }

ODD_PRIME(prime_a, A)
ODD_PRIME(prime_b, B)
ODD_PRIME(prime_c, C)

// A transform of `size` values that stand `by` apart.
#define LINE(size, prime, at, by)                                                                       \
    if (size == 2) pair(at, (at) + (by));                                                               \
    else if (size == 3) three(at, by);                                                                  \
    else if (size == 4) four(at, (at) + (by), (at) + 2 * (by), (at) + 3 * (by));                        \
    else if (size == 5) five(at, by);                                                                   \
    else if (size == 8) eight(at, by);                                                                  \
    else if (size > 5) prime(at, by);

// Turns v[i] by k / RADIX of a circle.
void turn(uint i, uint k) {
    vec2 x = v[i];
    if (k == 0) return;
    if (4 * k == RADIX) v[i] = turned(x);
    else if (2 * k == RADIX) v[i] = -x;
    else if (4 * k == 3 * RADIX) v[i] = -turned(x);
    else if (8 * k == RADIX) v[i] = HALF_ROOT * (x + turned(x));
    else if (8 * k == 3 * RADIX) v[i] = HALF_ROOT * (turned(x) - x);
    else v[i] = times(x, root(k));
}

// Where butterfly() leaves output k.
uint place(uint k) {
    uint inner = k / A;
    return k % A * (B * C) + inner % B * C + inner / B;
}

void butterfly() {
    [[unroll]] for (uint j = 0; j < B * C; ++j) {
        LINE(A, prime_a, j, B * C)
        [[unroll]] for (uint k = 1; k < A; ++k) turn(k * (B * C) + j, j * k);
    }
    [[unroll]] for (uint a = 0; a < A; ++a) {
        [[unroll]] for (uint j = 0; j < C; ++j) {
            LINE(B, prime_b, a * (B * C) + j, C)
            [[unroll]] for (uint k = 1; k < B; ++k) turn(a * (B * C) + k * C + j, A * j * k);
        }
        [[unroll]] for (uint b = 0; b < B; ++b) {
            LINE(C, prime_c, a * (B * C) + b * C, 1)
        }
    }
}
