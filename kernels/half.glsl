// Complex values in memory are two float32. In modules built with HALF they are two halves in one uint, but arithmetic
// is in float32 as well. A device may round in `packHalf2x16` in any way. Results would then differ between devices,
// and drift toward zero on some. Devices that guarantee rounding to nearest, ties to even, use it. ROUNDS_HALVES comes
// with the execution mode that requests this. For other devices the code below makes the bits (see half.rs).
// `unpackHalf2x16` may flush subnormal halves to zero, except on devices that guarantee the opposite (PRESERVES_HALVES,
// in the same way). Other devices read halves as integers. This code requires no feature of the device.
//
// A kernel that includes this file is built as two modules, NAME and, with HALF, NAME_half.
//
// COMPLEX and COMPLEX2 are one and two values in memory. LOAD and LOAD2 convert them to vec2 and vec4, and STORE and
// STORE2 convert back.

#ifdef HALF

layout(constant_id = 100) const uint PRESERVES_HALVES = 0;
layout(constant_id = 101) const uint ROUNDS_HALVES = 0;

// Returns the exact value of a half.
float half_value(uint bits) {
    uint size = bits & 0x7fffu;
    // Halves below 2^-14 are whole multiples of 2^-24.
    float value = size < 0x400u ? float(size) * 5.9604644775390625e-8
                                : uintBitsToFloat((size << 13) + (size < 0x7c00u ? 0x38000000u : 0x70000000u));
    return uintBitsToFloat(floatBitsToUint(value) | ((bits & 0x8000u) << 16));
}

vec2 half_unpack(uint stored) {
    return PRESERVES_HALVES == 1u ? unpackHalf2x16(stored)
                                  : vec2(half_value(stored & 0xffffu), half_value(stored >> 16));
}

uint half_bits(float x) {
    uint bits = floatBitsToUint(x), size = bits & 0x7fffffffu;
    // Rounds to eleven bits. A carry continues into the exponent, which counts from -15 in a half and from -127 in a
    // float.
    uint normal = (size + 0xfffu + ((size >> 13) & 1u) - 0x38000000u) >> 13;
    // Halves below 2^-14 are 2^-24 apart, like float32 next to 1/2.
    precise float beside = uintBitsToFloat(size) + 0.5;
    uint value = size < 0x38800000u ? floatBitsToUint(beside) - 0x3f000000u : normal;
    if (size >= 0x477ff000u) value = size > 0x7f800000u ? 0x7e00u : 0x7c00u;
    return value | ((bits >> 16) & 0x8000u);
}

uint half_pack(vec2 z) { return ROUNDS_HALVES == 1u ? packHalf2x16(z) : half_bits(z.x) | (half_bits(z.y) << 16); }

#define COMPLEX uint
#define COMPLEX2 uvec2
#define LOAD(stored) half_unpack(stored)
#define LOAD2(stored) half_unpack2(stored)
#define STORE(z) half_pack(z)
#define STORE2(z) half_pack2(z)

vec4 half_unpack2(uvec2 stored) { return vec4(half_unpack(stored.x), half_unpack(stored.y)); }
uvec2 half_pack2(vec4 z) { return uvec2(half_pack(z.xy), half_pack(z.zw)); }

#else

#define COMPLEX vec2
#define COMPLEX2 vec4
#define LOAD(stored) (stored)
#define LOAD2(stored) (stored)
#define STORE(z) (z)
#define STORE2(z) (z)

#endif
