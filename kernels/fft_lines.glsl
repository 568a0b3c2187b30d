// Short transforms of values in registers, forward, in place and in natural order.
//
// The shader that includes this declares `v`, the registers, and `roots`, a table of exp(-i 2 pi k / n). All indices of
// v are known when the pipeline is made. For any factor A of a radix, see fft_butterfly.glsl.

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
#define ODD_PRIME(name, P, RADIX, root)                                                                   \
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

// A transform of `size` values that stand `by` apart.
#define LINE(size, prime, at, by)                                                                       \
    if (size == 2) pair(at, (at) + (by));                                                               \
    else if (size == 3) three(at, by);                                                                  \
    else if (size == 4) four(at, (at) + (by), (at) + 2 * (by), (at) + 3 * (by));                        \
    else if (size == 5) five(at, by);                                                                   \
    else if (size == 8) eight(at, by);                                                                  \
    else if (size > 5) prime(at, by);

// Multiplies v[i] by the i-th power of roots[k], i < radix: two roots from memory, the others short products of them.
void twist(uint radix, uint k) {
    vec2 one = roots[k], eighth = radix > 8 ? roots[8 * k] : one, high = eighth, low = one;
    [[unroll]] for (uint i = 1; i < radix; ++i) {
        if (i > 1) {
            if (i > 8 && i % 8 == 0) high = times(high, eighth);
            low = i % 8 == 0 ? high : times(low, one);
        }
        v[i] = times(v[i], low);
    }
}
