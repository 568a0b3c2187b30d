#version 450

// A pass of a Stockham transform whose radix is a large prime: each invocation sums one output by the definition.
// The data are laid out as in fft_pass.comp. Columns: x is the column, y the output. Rows: x is the output, y the row.

layout(local_size_x_id = 1, local_size_y = 1) in;
layout(constant_id = 0) const bool ROWS = false;

layout(std430, binding = 0) readonly buffer From { vec2 from[]; };
layout(std430, binding = 1) writeonly buffer To { vec2 to[]; };
// exp(-i 2 pi k / n).
layout(std430, binding = 2) readonly buffer Roots { vec2 roots[]; };
layout(push_constant) uniform Args {
    uint n, done, step;
    uint lines, inverse;
    uint from_first, from_wrap, from_row, from_frame;
    uint to_first, to_wrap, to_row, to_frame;
    uint radix;
};

vec2 times(vec2 a, vec2 b) { return vec2(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x); }

void transform(uint line, uint o) {
    // o = (t - k) radix + k + q done
    uint k = o % done, q = o / done % radix, t = o / (done * radix) * done + k;
    uint column = line + from_first;
    if (column >= from_wrap) column -= from_wrap;
    uint at = gl_WorkGroupID.z * from_frame + (ROWS ? line * from_row + t : t * from_row + column);
    uint by = n / radix * (ROWS ? 1 : from_row);
    uint turn = 0, turns = (k + q * done) * step;
    // Sums of sums: the rounding of a long sum grows with its length.
    vec2 sum = vec2(0.0);
    for (uint i = 0; i < radix;) {
        vec2 part = vec2(0.0);
        for (uint end = min(i + 16, radix); i < end; ++i) {
            vec2 x = from[at];
            part += times(inverse != 0 ? x.yx : x, roots[turn]);
            at += by;
            turn += turns;
            if (turn >= n) turn -= n;
        }
        sum += part;
    }
    column = line + to_first;
    if (column >= to_wrap) column -= to_wrap;
    to[gl_WorkGroupID.z * to_frame + (ROWS ? line * to_row + o : o * to_row + column)] = inverse != 0 ? sum.yx : sum;
}

void main() {
    uint x = gl_GlobalInvocationID.x;
    if (ROWS) {
        if (x >= n) return;
        for (uint y = gl_WorkGroupID.y; y < lines; y += gl_NumWorkGroups.y) transform(y, x);
    } else {
        if (x >= lines) return;
        for (uint y = gl_WorkGroupID.y; y < n; y += gl_NumWorkGroups.y) transform(x, y);
    }
}
