#version 450
#extension GL_GOOGLE_include_directive : require
#include "trig.glsl"
#include "half.glsl"

// window[frame] *= weight * exp(2 pi i turns) inside the sub-frame's own spans, zero outside. x is the column, y the
// row (strided) and z the frame. Turns are linear in row and column. On the way back their sign is reversed.

layout(local_size_x = WIDTH) in;
// Four float32 per sub-frame (turns per row, turns per column, turns at the first bin, weight), then spans (sub-frames,
// rows, 2).
layout(std430, binding = 0) readonly buffer Moments { uint moments[]; };
layout(std430, binding = 1) buffer Window { COMPLEX window[]; };
layout(push_constant) uniform Args {
    uint rows, columns, frames, first, back;
    // Number of values from one frame to the next.
    uint window_stride;
};

void main() {
    uint k = gl_GlobalInvocationID.x;
    if (k >= columns) return;
    uint frame = gl_GlobalInvocationID.z, of = first + frame;
    vec4 shift = uintBitsToFloat(uvec4(moments[4 * of], moments[4 * of + 1], moments[4 * of + 2], moments[4 * of + 3]));
    precise float along = shift.y * float(k);
    along -= roundEven(along);
    precise float along_phase = along * (back == 0 ? 6.28318531 : -6.28318531);
    vec2 e = cos_sin(along_phase);
    for (uint j = gl_WorkGroupID.y; j < rows; j += gl_NumWorkGroups.y) {
        uint span = 4 * frames + 2 * (of * rows + j);
        uint at = frame * window_stride + j * columns + k;
        if (shift.w == 0.0 || k < moments[span] || k >= moments[span + 1]) {
            window[at] = STORE(vec2(0.0));
            continue;
        }
        precise float down = shift.z + shift.x * float(j);
        down -= roundEven(down);
        precise float down_phase = down * (back == 0 ? 6.28318531 : -6.28318531);
        vec2 r = cos_sin(down_phase) * shift.w;
        vec2 f = vec2(e.x * r.x - e.y * r.y, e.x * r.y + e.y * r.x);
        vec2 z = LOAD(window[at]);
        window[at] = STORE(vec2(z.x * f.x - z.y * f.y, z.x * f.y + z.y * f.x));
    }
}
