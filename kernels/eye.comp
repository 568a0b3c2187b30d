#version 450
#extension GL_GOOGLE_include_directive : require
#include "trig.glsl"
#include "pair.glsl"

// transfer[j][k] *= exp(i 2 pi E), with E = sum c_ij u^i v^j in turns about the center of the pupil. x is the column, y
// the row (strided).

layout(local_size_x = WIDTH) in;
// Pairs (high, low) of the first place (u, v), of the step (u, v), and of the coefficients by i and then j.
layout(std430, binding = 0) readonly buffer Terms { vec2 terms[]; };
layout(std430, binding = 1) readonly buffer Spans { uvec2 spans[]; };
layout(std430, binding = 2) buffer Transfer { vec2 transfer[]; };
layout(push_constant) uniform Args {
    uint rows, columns, degree;
};

void main() {
    uint k = gl_GlobalInvocationID.x;
    if (k >= columns) return;
    vec2 u = pair_add(terms[0], pair_multiply(pair_of(k), terms[2]));
    for (uint j = gl_WorkGroupID.y; j < rows; j += gl_NumWorkGroups.y) {
        uvec2 span = spans[j];
        if (k < span.x || k >= span.y) continue;
        vec2 v = pair_add(terms[1], pair_multiply(pair_of(j), terms[3]));
        vec2 sum = vec2(0.0);
        // The sum goes from the last coefficient to the first.
        uint at = 4 + (degree + 1) * (degree + 2) / 2;
        for (uint i = 0; i <= degree; ++i) {
            vec2 row = vec2(0.0);
            for (uint power = 0; power <= i; ++power) row = pair_add(pair_multiply(row, v), terms[--at]);
            sum = pair_add(pair_multiply(sum, u), row);
        }
        precise float part = sum.x - roundEven(sum.x);
        part += sum.y;
        part -= roundEven(part);
        precise float phase = part * 6.28318531;
        vec2 e = cos_sin(phase);
        vec2 z = transfer[j * columns + k];
        transfer[j * columns + k] = vec2(z.x * e.x - z.y * e.y, z.x * e.y + z.y * e.x);
    }
}
