// Complex values in memory: two float32, or in modules built with HALF two halves in one uint, with the arithmetic in
// float32 all the same. `packHalf2x16` may round as the device likes, so that results would differ from device to
// device and drift towards zero on some. Devices that promise to round to the nearest, ties to even, pack by it (ROUNDS_HALVES
// comes with the execution mode that asks for it); on others the bits are made here (see half.rs). `unpackHalf2x16` may take
// subnormal halves for zero, but on devices that promise not to (PRESERVES_HALVES, likewise); on others they are read as
// integers. Nothing of this asks for a feature of the device.
//
// A kernel that includes this file is built twice: NAME and, with HALF, NAME_half.
//
// COMPLEX and COMPLEX2 are one and two values in memory; LOAD.. and STORE.. go between them and vec2 and vec4.

#ifdef HALF

layout(constant_id = 100) const uint PRESERVES_HALVES = 0;
layout(constant_id = 101) const uint ROUNDS_HALVES = 0;

// The value of a half, exactly.
float half_value(uint bits) {
    uint size = bits & 0x7fffu;
    // Below 2^-14: whole multiples of 2^-24.
    float value = size < 0x400u ? float(size) * 5.9604644775390625e-8 : uintBitsToFloat((size << 13) + (size < 0x7c00u ? 0x38000000u : 0x70000000u));
    return uintBitsToFloat(floatBitsToUint(value) | ((bits & 0x8000u) << 16));
}

vec2 half_unpack(uint stored) {
    return PRESERVES_HALVES == 1u ? unpackHalf2x16(stored) : vec2(half_value(stored & 0xffffu), half_value(stored >> 16));
}

uint half_bits(float x) {
    uint bits = floatBitsToUint(x), size = bits & 0x7fffffffu;
    // Eleven bits; a carry goes on into the exponent, which is counted from -15 in a half and from -127 in a float.
    uint normal = (size + 0xfffu + ((size >> 13) & 1u) - 0x38000000u) >> 13;
    // Below 2^-14 halves are 2^-24 apart, as float32 is next to 1/2.
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
