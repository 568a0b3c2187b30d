#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "relief.glsl"

// front = the picture, continued by mirroring, without the near side's color on the far rim of a tear. fringe = the
// removed share of each pixel. nearest = the rims, for relief_jump.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Picture { float picture[]; };
layout(std430, binding = 1) readonly buffer Sharp { float sharp[]; };
layout(std430, binding = 2) writeonly buffer Front { float front[]; };
layout(std430, binding = 3) writeonly buffer Fringe { float fringe[]; };
layout(std430, binding = 4) writeonly buffer Nearest { uint nearest[]; };

layout(push_constant) uniform Args { RELIEF_ARGS };

// Returns the pixel of the picture itself.
uint source(ivec2 place) {
    ivec2 size = ivec2(width, height);
    // Two periods more keep the dividend positive.
    ivec2 at = place - int(pad);
    at = ((at % (2 * size)) + 2 * size) % (2 * size);
    at = min(at, 2 * size - 1 - at);
    return uint(at.y) * width + uint(at.x);
}

vec3 color(uint pixel) {
    uint at = height * width + 3 * pixel;
    return vec3(picture[at], picture[at + 1], picture[at + 2]);
}

void main() {
    ivec2 size = RELIEF_SIZE;
    uint pixels = uint(size.x * size.y);
    for (uint p = gl_GlobalInvocationID.x; p < pixels; p += gl_NumWorkGroups.x * WIDTH) {
        ivec2 place = place_of(p, size);
        uint own = source(place);
        float here = sharp[own], level = RELIEF_ABSENT, share = 0.0;
        vec3 pure = color(own), near = vec3(0.0);
        int along = -1;
        for (int i = 7; i >= 0; --i) {
            ivec2 q = place + AROUND[i];
            if (is_inside(q, size) && sharp[source(q)] > here + tear) along = i;
        }
        bool is_rim = along >= 0;
        if (is_rim) {
            ivec2 direction = AROUND[along];
            uint beside = source(place + direction);
            float top = sharp[beside];
            // Pure colors are one pixel further in, and two pixels further out.
            uint inner = source(place + 2 * direction);
            bool is_inner = is_inside(place + 2 * direction, size) && is_like(sharp[inner], top, tear);
            vec3 ahead = color(is_inner ? inner : beside);
            bool found = false;
            vec3 back = vec3(0.0);
            for (int k = 2; k >= 1 && !found; --k) {
                ivec2 outer = place - k * direction;
                if (is_inside(outer, size) && is_like(sharp[source(outer)], here, tear)) {
                    back = color(source(outer));
                    found = true;
                }
            }
            // This color is approximated by back + part (ahead - back).
            precise float dot_product = 0.0, norm = 0.0;
            for (int k = 0; k < 3; ++k) {
                dot_product += (pure[k] - back[k]) * (ahead[k] - back[k]);
                norm += (ahead[k] - back[k]) * (ahead[k] - back[k]);
            }
            // Less than half of the pixel is near, because otherwise the map would show that. The color must also be
            // such a mixture, which excludes texture.
            precise float part = min(dot_product / max(norm, 1e-6), 0.6);
            precise float strange = 0.0;
            for (int k = 0; k < 3; ++k) {
                precise float rest = pure[k] - back[k] - part * (ahead[k] - back[k]);
                strange += rest * rest;
            }
            precise float most = 0.05 * part * part * norm;
            if (found && part >= 0.03 && strange <= most) {
                level = top;
                share = part;
                near = ahead;
                pure = back;
            }
        }
        front[p] = here;
        fringe[p] = level;
        fringe[plane + p] = share;
        for (uint k = 0; k < 3; ++k) {
            front[plane + 3 * p + k] = pure[k];
            fringe[2 * plane + 3 * p + k] = near[k];
        }
        nearest[p] = is_rim ? 0 : RELIEF_NOWHERE;
        nearest[plane + p] = RELIEF_NOWHERE;
    }
}
