#version 450
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

// canvas = one layer over canvas, with light and dioptres per pixel. The arithmetic has the order of `composition` in
// tools/openxr. A workgroup is a part of a row of the picture.

layout(local_size_x = WIDTH) in;
layout(std430, binding = 0) readonly buffer Color { uint colors[]; };
layout(std430, binding = 1) readonly buffer Depth { uint depths[]; };
layout(std430, binding = 2) readonly buffer Tables { uint tables[]; };
layout(std430, binding = 3) buffer Canvas { vec4 canvas[]; };

layout(push_constant) uniform Args {
    uint height, width, record;
    float angle;
};

uint word(uint at) { return tables[record + at]; }
float real(uint at) { return uintBitsToFloat(tables[record + at]); }
vec3 real3(uint at) { return vec3(real(at), real(at + 1), real(at + 2)); }

// Returns the light of a half, which is neither negative nor unlimited. A NaN becomes 0. `unpackHalf2x16` may flush
// subnormal halves to zero.
float half_light(uint bits) {
    if (bits > 0x7c00u) return 0.0;
    uint exponent = bits >> 10, fraction = bits & 1023u;
    if (exponent == 31) return COMPOSE_BRIGHTEST;
    if (exponent == 0) return float(fraction) / 16777216.0;
    return uintBitsToFloat((exponent + 112u) << 23 | fraction << 13);
}

float eight(uint value, bool coded) {
    value &= 255u;
    return coded ? uintBitsToFloat(tables[value]) : float(value) / 255.0;
}

// Returns the light of a texel multiplied by its opacity, and the opacity.
vec4 texel(uint row, uint column) {
    uint form = word(COMPOSE_COLOR), flags = word(COMPOSE_FLAGS);
    uint size = form == COMPOSE_RGBA16 ? 8 : 4;
    uint at = (word(COMPOSE_COLOR + 1) + row * word(COMPOSE_COLOR + 2) + column * size) / 4;
    uint first = colors[at];
    bool coded = (flags & COMPOSE_SRGB) != 0;
    vec4 found;
    if (form == COMPOSE_RGBA16) {
        uint second = colors[at + 1];
        found = vec4(half_light(first & 0xffffu), half_light(first >> 16), half_light(second & 0xffffu),
            min(half_light(second >> 16), 1.0));
    } else if (form == COMPOSE_RGB10A2) {
        uvec3 ten = uvec3(first, first >> 10, first >> 20) & 1023u;
        found = vec4(vec3(ten) / 1023.0, float(first >> 30) / 3.0);
    } else {
        found = vec4(eight(first, coded), eight(first >> 8, coded), eight(first >> 16, coded), eight(first >> 24, false));
        if (form == COMPOSE_BGRA8) found = found.bgra;
    }
    if ((flags & COMPOSE_BLENDS) == 0) return vec4(found.rgb, 1.0);
    precise float opacity = (flags & COMPOSE_INVERTED) != 0 ? 1.0 - found.a : found.a;
    precise vec3 light = (flags & COMPOSE_UNPREMULTIPLIED) != 0 ? found.rgb * opacity : found.rgb;
    return vec4(light, opacity);
}

// Returns the dioptres at a place of the depth.
float distance_of(uint row, uint column) {
    uint form = word(COMPOSE_DEPTH);
    uint size = form == COMPOSE_D16 ? 2 : 4;
    uint at = word(COMPOSE_DEPTH + 1) + row * word(COMPOSE_DEPTH + 2) + column * size;
    uint stored = depths[at / 4];
    float least = real(COMPOSE_RANGE), most = real(COMPOSE_RANGE + 1);
    float near = real(COMPOSE_RANGE + 2), far = real(COMPOSE_RANGE + 3);
    precise float depth;
    if (form == COMPOSE_D16) depth = float((stored >> (8 * (at & 2u))) & 0xffffu) / 65535.0;
    else if (form == COMPOSE_D24) depth = float(stored & 0xffffffu) / 16777215.0;
    else depth = uintBitsToFloat(stored);
    precise float along = clamp((depth - least) / (most - least), 0.0, 1.0);
    if (form == COMPOSE_D32 && (stored & 0x7f800000u) == 0x7f800000u) {
        // A device may compute with infinity and NaN in any way.
        if ((stored & 0x7fffffu) != 0) return 0.0;
        along = stored >> 31 == 0 ? 1.0 : 0.0;
    }
    precise float dioptres = near + along * (far - near);
    return clamp(dioptres, 0.0, COMPOSE_NEAREST);
}

// Returns the light of a view at a pixel. All samples below the pixel count.
vec4 viewed(uvec2 pixel) {
    uint down = word(COMPOSE_TABLES + 1) + COMPOSE_TAP * pixel.y;
    uint across = word(COMPOSE_TABLES) + COMPOSE_TAP * pixel.x;
    precise vec4 sum = vec4(0.0);
    for (uint i = 0; i < tables[down + 1]; ++i) {
        precise vec4 line = vec4(0.0);
        for (uint j = 0; j < tables[across + 1]; ++j) {
            float weight = uintBitsToFloat(tables[tables[across + 2] + j]);
            line += weight * texel(tables[down] + i, tables[across] + j);
        }
        sum += uintBitsToFloat(tables[tables[down + 2] + i]) * line;
    }
    return sum;
}

// Returns the light between four texels, at a place from 0 to 1 in the image. The edge continues outside.
vec4 between(vec2 place) {
    uvec2 last = uvec2(word(COMPOSE_COLOR + 4), word(COMPOSE_COLOR + 3)) - 1;
    precise vec2 at = clamp(place * vec2(last + 1) - 0.5, vec2(0.0), vec2(last));
    uvec2 first = min(uvec2(at), last), second = min(first + 1, last);
    precise vec2 share = at - floor(at);
    precise vec4 sum = (1.0 - share.y) * (1.0 - share.x) * texel(first.y, first.x);
    sum += (1.0 - share.y) * share.x * texel(first.y, second.x);
    sum += share.y * (1.0 - share.x) * texel(second.y, first.x);
    sum += share.y * share.x * texel(second.y, second.x);
    return sum;
}

// Returns the arc tangent of y / x in all four quadrants. GLSL's own may be wrong by 4096 units.
float arc_tangent(float y, float x) {
    float big = abs(y), small = abs(x), base = 0.0;
    float t;
    if (big > COMPOSE_ATAN_HIGH * small) {
        base = 0.5 * COMPOSE_PI;
        t = -small / big;
    } else if (big > COMPOSE_ATAN_LOW * small) {
        base = 0.25 * COMPOSE_PI;
        t = (big - small) / (big + small);
    } else {
        t = small > 0.0 ? big / small : 0.0;
    }
    float s = t * t;
    float series = COMPOSE_ATAN_3 + s * (COMPOSE_ATAN_5 + s * (COMPOSE_ATAN_7 + s * COMPOSE_ATAN_9));
    float turned = base + (t + t * s * series);
    if (x < 0.0) turned = COMPOSE_PI - turned;
    return y < 0.0 ? -turned : turned;
}

// Finds the place of a ray in the image of a quad, and the inverse of its distance. Returns false for a ray that
// misses.
bool meets_quad(vec3 ray, out vec2 place, out float dioptres) {
    vec3 normal = real3(COMPOSE_SURFACE), right = real3(COMPOSE_SURFACE + 4), up = real3(COMPOSE_SURFACE + 8);
    float facing = dot(ray, normal);
    float away = real(COMPOSE_SURFACE + 3) / facing;
    place = vec2(0.5 + (away * dot(ray, right) - real(COMPOSE_SURFACE + 7)),
        0.5 - (away * dot(ray, up) - real(COMPOSE_SURFACE + 11)));
    dioptres = 1.0 / away;
    return facing < 0.0 && away > 0.0;
}

bool meets_cylinder(vec3 ray, out vec2 place, out float dioptres) {
    vec3 direction = vec3(dot(real3(COMPOSE_SURFACE), ray), dot(real3(COMPOSE_SURFACE + 3), ray),
        dot(real3(COMPOSE_SURFACE + 6), ray));
    vec3 origin = real3(COMPOSE_SURFACE + 9);
    float radius = real(COMPOSE_SURFACE + 12);
    float square = direction.x * direction.x + direction.z * direction.z;
    vec3 point;
    bool met = square > 0.0;
    if (radius > 0.0) {
        // The farther of the two places on the cylinder is on its inside.
        float along = (origin.x * direction.x + origin.z * direction.z) / square;
        float beyond = (origin.x * origin.x + origin.z * origin.z - radius * radius) / square;
        float root = along * along - beyond;
        float away = sqrt(max(root, 0.0)) - along;
        point = (origin + away * direction) / radius;
        dioptres = 1.0 / away;
        met = met && root >= 0.0 && away > 0.0;
    } else {
        point = direction / sqrt(square);
        dioptres = 0.0;
    }
    place = vec2(0.5 + arc_tangent(point.x, -point.z) / real(COMPOSE_SURFACE + 13),
        0.5 - point.y / real(COMPOSE_SURFACE + 14));
    return met;
}

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (pixel.x >= width || pixel.y >= height) return;
    uint at = pixel.y * width + pixel.x;
    vec4 light;
    float dioptres = real(COMPOSE_DIOPTRES);
    uint kind = word(COMPOSE_KIND);
    if (kind == COMPOSE_VIEW) {
        light = viewed(pixel);
        // The nearest depth, because a mean of two distances is neither of them.
        if (word(COMPOSE_DEPTH) != 0 && light.a >= COMPOSE_SOLID) {
            uint row = tables[word(COMPOSE_TABLES + 3) + pixel.y], column = tables[word(COMPOSE_TABLES + 2) + pixel.x];
            if (row != COMPOSE_OUTSIDE && column != COMPOSE_OUTSIDE) dioptres = distance_of(row, column);
        }
    } else {
        precise vec2 steps = vec2(pixel) - (vec2(width, height) - 1.0) / 2.0;
        vec3 ray = vec3(steps.x * angle, -steps.y * angle, -1.0);
        vec2 place;
        bool met = kind == COMPOSE_QUAD ? meets_quad(ray, place, dioptres) : meets_cylinder(ray, place, dioptres);
        if (!met || !(place.x >= 0.0 && place.x <= 1.0 && place.y >= 0.0 && place.y <= 1.0)) return;
        light = between(place);
        dioptres = clamp(dioptres, 0.0, COMPOSE_NEAREST);
    }
    vec4 before = canvas[at];
    precise float through = 1.0 - light.a;
    precise vec3 blended = light.rgb + through * before.rgb;
    canvas[at] = vec4(blended, light.a >= COMPOSE_SOLID ? dioptres : before.a);
}
