#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// splats = the splats of the order in the picture of a camera. The arithmetic has the order of project_splats.rs.

layout(local_size_x = TILE_THREADS) in;
layout(std430, binding = 0) readonly buffer Gaussians { uint gaussians[]; };
layout(std430, binding = 1) readonly buffer Order { uint order[]; };
layout(std430, binding = 2) writeonly buffer Splats { uint splats[]; };

layout(push_constant) uniform Args {
    float axes[9];
    float place[3];
    float place_rest[3];
    float by[2];
    float moved[2];
    float focal;
    uint height, width, count, kind;
};

float word(uint at) { return uintBitsToFloat(gaussians[at]); }

// Returns the harmonics of the degrees 1 to 3 in a direction of length 1, as in splat_colors.rs.
void harmonics(vec3 d, out float weights[15]) {
    float x = d.x, y = d.y, z = d.z, xx = x * x, yy = y * y, zz = z * z;
    weights[0] = -SPLAT_C1 * y;
    weights[1] = SPLAT_C1 * z;
    weights[2] = -SPLAT_C1 * x;
    weights[3] = SPLAT_C2_0 * x * y;
    weights[4] = SPLAT_C2_1 * y * z;
    weights[5] = SPLAT_C2_2 * (2.0 * zz - xx - yy);
    weights[6] = SPLAT_C2_3 * x * z;
    weights[7] = SPLAT_C2_4 * (xx - yy);
    weights[8] = SPLAT_C3_0 * y * (3.0 * xx - yy);
    weights[9] = SPLAT_C3_1 * x * y * z;
    weights[10] = SPLAT_C3_2 * y * (4.0 * zz - xx - yy);
    weights[11] = SPLAT_C3_3 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy);
    weights[12] = SPLAT_C3_4 * x * (4.0 * zz - xx - yy);
    weights[13] = SPLAT_C3_5 * z * (xx - yy);
    weights[14] = SPLAT_C3_6 * x * (xx - 3.0 * yy);
}

float half_at(uint at, uint i) {
    vec2 pair = unpackHalf2x16(gaussians[at + i / 2]);
    return i % 2 == 0 ? pair.x : pair.y;
}

// Returns the color in the direction in which the camera sees the splat whose words begin at `at`.
vec3 color(uint at, vec3 from, uint degree) {
    vec3 sum = vec3(word(at + 10), word(at + 11), word(at + 12));
    if (degree > 0) {
        vec3 along = vec3(axes[0], axes[1], axes[2]) * from.x + vec3(axes[3], axes[4], axes[5]) * from.y
            + vec3(axes[6], axes[7], axes[8]) * from.z;
        float weights[15];
        harmonics(along / max(length(from), 1e-30), weights);
        uint harmonic_count = (degree + 1) * (degree + 1) - 1;
        for (uint k = 0; k < harmonic_count; ++k) {
            for (uint c = 0; c < 3; ++c) sum[c] += weights[k] * half_at(at + SPLAT_PLAIN, 3 * k + c);
        }
    }
    return max(sum, vec3(0.0));
}

// Returns the covariance (xx, xy, xz, yy, yz, zz) of the splat in the axes of the camera.
void spread_of(uint at, out float spread[6]) {
    for (uint i = 0; i < 6; ++i) spread[i] = word(at + 3 + i);
    if ((kind & SPLAT_ORDERED) != 0) return;
    // It is symmetric, so the order of rows and columns does not matter.
    mat3 whole = mat3(spread[0], spread[1], spread[2], spread[1], spread[3], spread[4], spread[2], spread[4], spread[5]);
    uint entry = 0;
    for (uint a = 0; a < 3; ++a) {
        for (uint b = a; b < 3; ++b) {
            precise float sum = 0.0;
            for (uint i = 0; i < 3; ++i) {
                precise float row = 0.0;
                for (uint j = 0; j < 3; ++j) row += axes[3 * a + i] * whole[i][j] * axes[3 * b + j];
                sum += row;
            }
            spread[entry++] = sum;
        }
    }
}

// Returns the first pixel and the one after the last, or 0 if there are none.
uint span(float center, float far, uint most) {
    float first = clamp(floor(center - far), 0.0, float(most));
    float end = clamp(floor(center + far) + 2.0, 0.0, float(most));
    return first < end ? uint(first) | uint(end) << 16 : 0;
}

void project(uint i) {
    uint to = SPLAT_WORDS * i, degree = kind & SPLAT_DEGREE;
    // Without rows and columns, the other values are not read.
    splats[to + 10] = 0;
    splats[to + 11] = 0;
    bool ordered = (kind & SPLAT_ORDERED) != 0;
    uint at = (ordered ? i : order[i]) * (SPLAT_PLAIN + (3 * ((degree + 1) * (degree + 1) - 1) + 1) / 2);
    precise vec3 p = vec3(word(at), word(at + 1), word(at + 2));
    if (!ordered) {
        precise vec3 from = (p - vec3(place[0], place[1], place[2])) - vec3(place_rest[0], place_rest[1], place_rest[2]);
        for (uint a = 0; a < 3; ++a) {
            precise float along = axes[3 * a] * from.x + axes[3 * a + 1] * from.y + axes[3 * a + 2] * from.z;
            p[a] = along;
        }
    }
    float s[6];
    spread_of(at, s);
    precise vec3 from = vec3(p.x - by[0], p.y - by[1], p.z);
    precise float scale = focal / p.z;
    vec2 size = vec2(float(width), float(height));
    precise vec2 center = scale * from.xy + (size - 1.0) / 2.0 + vec2(moved[0], moved[1]);
    precise vec2 most = SPLAT_BEYOND * (size / 2.0 / focal);
    precise vec2 slope = -scale * clamp(from.xy / p.z, -most, most);
    precise float xx = scale * (scale * s[0] + 2.0 * slope.x * s[2]) + slope.x * slope.x * s[5];
    precise float xy = scale * (scale * s[1] + slope.y * s[2] + slope.x * s[4]) + slope.x * slope.y * s[5];
    precise float yy = scale * (scale * s[3] + 2.0 * slope.y * s[4]) + slope.y * slope.y * s[5];
    bool antialiased = (kind & SPLAT_ANTIALIASED) != 0;
    float pixel = antialiased ? SPLAT_PIXEL_ANTIALIASED : SPLAT_PIXEL;
    precise float wide = xx + pixel;
    precise float high = yy + pixel;
    precise float area = wide * high - xy * xy;
    float opacity = word(at + 9);
    if (antialiased) {
        precise float own = xx * yy - xy * xy;
        opacity *= sqrt(max(own / area, SPLAT_LEAST));
    }
    if (!(area > 0.0 && area <= 3.4028234e38 && opacity >= SPLAT_FAINTEST)) return;
    float reach = 2.0 * log(opacity / SPLAT_FAINTEST);
    uint columns = span(center.x, sqrt(reach * wide), width);
    uint rows = span(center.y, sqrt(reach * high), height);
    if (columns == 0 || rows == 0) return;
    vec3 paint = color(at, from, degree);
    precise vec3 conic = vec3(high / area, -xy / area, wide / area);
    float values[10] = {
        center.x, center.y, conic.x, conic.y, conic.z, opacity, paint.x, paint.y, paint.z, 1.0 / p.z
    };
    for (uint k = 0; k < 10; ++k) splats[to + k] = floatBitsToUint(values[k]);
    splats[to + 10] = columns;
    splats[to + 11] = rows;
}

void main() {
    uint step_size = gl_NumWorkGroups.x * TILE_THREADS;
    for (uint i = gl_GlobalInvocationID.x; i < count; i += step_size) project(i);
}
