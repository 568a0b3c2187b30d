// Forward transforms of `a` times `b` values in registers. The input is in natural order, the output in the order of
// `place`.
//
// A register holds two complex numbers, (re, im, re, im), of two columns or of two neighboring butterflies. Memory is
// therefore accessed 16 bytes at a time. This helps software devices most, because each of their accesses has a fixed
// cost. All sizes are specialization constants. The compiler of the pipeline therefore unrolls all loops and knows all
// indices of v.

#extension GL_EXT_control_flow_attributes : require
#include "constants.glsl"

vec4 v[2 * FFT_LARGEST_RADIX];

// Multiplies by -i.
vec4 quarter(vec4 a) { return vec4(a.y, -a.x, a.w, -a.z); }

// Products of complex numbers, pair by pair.
vec4 times(vec4 a, vec4 w) {
    return vec4(a.x * w.x - a.y * w.y, a.x * w.y + a.y * w.x, a.z * w.z - a.w * w.w, a.z * w.w + a.w * w.z);
}
vec4 times(vec4 a, vec2 w) { return times(a, w.xyxy); }

// Returns exp(-i 2 pi m / n) of constants, which the compiler computes. The angle is within pi / 4, and the result has
// the precision of float32.
vec2 turn(uint m, uint n) {
    uint eighths = 8u * (m % n);
    uint octant = eighths / n, rest = eighths % n;
    bool mirror = (octant & 1u) != 0u;
    float x = 0.785398163397448 * (float(mirror ? n - rest : rest) / float(n));
    float q = x * x;
    float s = x * (1.0 + q * (-1.0 / 6.0 + q * (1.0 / 120.0 + q * (-1.0 / 5040.0 + q * (1.0 / 362880.0)))));
    float c = 1.0 + q * (-0.5 + q * (1.0 / 24.0 + q * (-1.0 / 720.0 + q * (1.0 / 40320.0))));
    if (mirror) {
        s = -s;
        octant++;
    }
    uint h = (octant / 2u) & 3u;
    vec2 z = h == 0u ? vec2(c, s) : h == 1u ? vec2(-s, c) : h == 2u ? vec2(-c, -s) : vec2(s, -c);
    return vec2(z.x, -z.y);
}

// The functions below transform values at v[a], v[a + d], v[a + 2 d], ... in place. Outputs are in order.

void dft2(uint a, uint d) {
    vec4 x = v[a], y = v[a + d];
    v[a] = x + y;
    v[a + d] = x - y;
}

void dft3(uint a, uint d) {
    vec4 t = v[a + d] + v[a + 2u * d];
    vec4 u = 0.866025403784439 * quarter(v[a + d] - v[a + 2u * d]);
    vec4 m = v[a] - 0.5 * t;
    v[a] += t;
    v[a + d] = m + u;
    v[a + 2u * d] = m - u;
}

void dft4(uint a, uint d) {
    vec4 p = v[a] + v[a + 2u * d], q = v[a] - v[a + 2u * d];
    vec4 r = v[a + d] + v[a + 3u * d], s = quarter(v[a + d] - v[a + 3u * d]);
    v[a] = p + r;
    v[a + d] = q + s;
    v[a + 2u * d] = p - r;
    v[a + 3u * d] = q - s;
}

void dft8(uint a, uint d) {
    const float h = 0.707106781186548;
    vec4 t[8];
    [[unroll]] for (uint i = 0u; i < 4u; i++) {
        t[i] = v[a + i * d] + v[a + (i + 4u) * d];
        t[i + 4u] = v[a + i * d] - v[a + (i + 4u) * d];
    }
    t[5] = h * (t[5] + quarter(t[5]));
    t[6] = quarter(t[6]);
    t[7] = h * (quarter(t[7]) - t[7]);
    [[unroll]] for (uint i = 0u; i < 2u; i++) {
        vec4 p = t[4u * i] + t[4u * i + 2u], q = t[4u * i] - t[4u * i + 2u];
        vec4 r = t[4u * i + 1u] + t[4u * i + 3u], s = quarter(t[4u * i + 1u] - t[4u * i + 3u]);
        v[a + i * d] = p + r;
        v[a + (i + 2u) * d] = q + s;
        v[a + (i + 4u) * d] = p - r;
        v[a + (i + 6u) * d] = q - s;
    }
}

// For odd primes, X[k], X[p - k] = x[0] + sum cos (x[j] + x[p - j]) -+ i sum sin (x[j] - x[p - j]).
void dft_odd(uint p, uint a, uint d) {
    vec4 t[6], u[6], first = v[a], sum = v[a];
    [[unroll]] for (uint j = 1u; j <= p / 2u; j++) {
        t[j - 1u] = v[a + j * d] + v[a + (p - j) * d];
        u[j - 1u] = quarter(v[a + j * d] - v[a + (p - j) * d]);
        sum += t[j - 1u];
    }
    v[a] = sum;
    [[unroll]] for (uint k = 1u; k <= p / 2u; k++) {
        vec4 m = first, n = vec4(0.0);
        [[unroll]] for (uint j = 1u; j <= p / 2u; j++) {
            vec2 w = turn((j * k) % p, p);
            m += w.x * t[j - 1u];
            n -= w.y * u[j - 1u];
        }
        v[a + k * d] = m + n;
        v[a + (p - k) * d] = m - n;
    }
}

void dft(uint size, uint a, uint d) {
    if (size == 2u) dft2(a, d);
    else if (size == 3u) dft3(a, d);
    else if (size == 4u) dft4(a, d);
    else if (size == 8u) dft8(a, d);
    else if (size > 1u) dft_odd(size, a, d);
}

// Output k of butterfly(a, b, at) is at v[at + place(k, a, b)].
uint place(uint k, uint a, uint b) { return (k % a) * b + k / a; }

void butterfly(uint a, uint b, uint at) {
    [[unroll]] for (uint n = 0u; n < b; n++) dft(a, at + n, b);
    if (b > 1u) {
        [[unroll]] for (uint k = 0u; k < a; k++) {
            [[unroll]] for (uint n = 1u; n < b; n++) {
                if (k > 0u) v[at + k * b + n] = times(v[at + k * b + n], turn(k * n, a * b));
            }
            dft(b, at + k * b, 1u);
        }
    }
}

// Returns the second power of w that tables hold next to w, for a radix.
uint table_power(uint radix) { return radix <= 4u ? 2u : 4u; }

// Multiplies v[at + k] by w^k, from w and its power. This needs one access to the table instead of one per value. The
// powers are products of at most four factors.
void twist(uint at, uint radix, vec4 w, vec4 w_power) {
    uint power = table_power(radix);
    vec4 low[4];
    low[1] = w;
    [[unroll]] for (uint k = 2u; k < power; k++) low[k] = times(low[k / 2u], low[k - k / 2u]);
    [[unroll]] for (uint k = 1u; k < power; k++) {
        if (k < radix) v[at + k] = times(v[at + k], low[k]);
    }
    vec4 high = w_power;
    [[unroll]] for (uint k = power; k < radix; k += power) {
        v[at + k] = times(v[at + k], high);
        [[unroll]] for (uint l = 1u; l < power; l++) {
            if (k + l < radix) v[at + k + l] = times(v[at + k + l], times(high, low[l]));
        }
        high = times(high, w_power);
    }
}
