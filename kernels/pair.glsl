// Numbers as unevaluated sums of two float32 (high, low). They have 48 bits without float64 (Dekker 1971, Knuth). All
// values are `precise`, because a fused or reordered operation would lose the low part.

// Returns a + b exactly, for |a| >= |b|.
vec2 pair_ordered_sum(float a, float b) {
    precise float s = a + b;
    precise float e = b - (s - a);
    return vec2(s, e);
}

// Returns a + b exactly.
vec2 pair_sum(float a, float b) {
    precise float s = a + b;
    precise float v = s - a;
    precise float e = (a - (s - v)) + (b - v);
    return vec2(s, e);
}

// Splits a number into two halves of 12 bits.
vec2 pair_split(float a) {
    precise float t = 4097.0 * a;
    precise float high = t - (t - a);
    precise float low = a - high;
    return vec2(high, low);
}

// Returns a b exactly, if nothing underflows.
vec2 pair_product(float a, float b) {
    precise float p = a * b;
    vec2 x = pair_split(a), y = pair_split(b);
    precise float e = ((x.x * y.x - p) + x.x * y.y + x.y * y.x) + x.y * y.y;
    return vec2(p, e);
}

vec2 pair_add(vec2 a, vec2 b) {
    vec2 s = pair_sum(a.x, b.x);
    precise float e = s.y + (a.y + b.y);
    return pair_ordered_sum(s.x, e);
}

vec2 pair_multiply(vec2 a, vec2 b) {
    vec2 p = pair_product(a.x, b.x);
    precise float e = p.y + (a.x * b.y + a.y * b.x);
    return pair_ordered_sum(p.x, e);
}

// Returns a / b as one float32 quotient, corrected by its remainder.
vec2 pair_divide(vec2 a, vec2 b) {
    precise float q = a.x / b.x;
    vec2 p = pair_multiply(vec2(q, 0.0), b);
    vec2 rest = pair_add(a, -p);
    precise float correction = rest.x / b.x;
    return pair_ordered_sum(q, correction);
}

// Returns the root of a >= 0 as one float32 root and one step of Newton.
vec2 pair_root(vec2 a) {
    precise float r = sqrt(max(a.x, 0.0));
    if (r == 0.0) return vec2(0.0);
    vec2 rest = pair_add(a, -pair_product(r, r));
    precise float correction = rest.x / (2.0 * r);
    return pair_ordered_sum(r, correction);
}

// Represents an integer exactly.
vec2 pair_of(uint n) {
    return pair_ordered_sum(float(n & 0xfffff000u), float(n & 0xfffu));
}
