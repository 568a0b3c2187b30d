// Reads the samples of an application. Define SAMPLE_WORD(i) and CURVE(i), which read a word of the samples and the
// light of a value of 16 bits in the sRGB curve, before this file is included.

// Avoids `unpackHalf2x16`, which may flush subnormal halves to zero. `bits` has 16 bits.
float half_value(uint bits) {
    uint exponent = (bits >> 10) & 31u, fraction = bits & 1023u;
    uint sign = (bits >> 15) << 31;
    if (exponent == 0) return uintBitsToFloat(floatBitsToUint(float(fraction) / 16777216.0) | sign);
    return uintBitsToFloat((exponent == 31 ? 0x7f800000u : (exponent + 112u) << 23) | fraction << 13 | sign);
}

// Returns the bits of the light of a sample.
uint light_of_sample(uint at, uint kind, uint coded) {
    if (kind == DECODE_F32) return SAMPLE_WORD(at);
    if (kind == DECODE_U8) {
        uint value = (SAMPLE_WORD(at >> 2) >> (8 * (at & 3u))) & 255u;
        return floatBitsToUint(coded != 0 ? CURVE(value * 257u) : float(value) / 255.0);
    }
    uint value = (SAMPLE_WORD(at >> 1) >> (16 * (at & 1u))) & 0xffffu;
    if (kind == DECODE_F16) return floatBitsToUint(half_value(value));
    return floatBitsToUint(coded != 0 ? CURVE(value) : float(value) / 65535.0);
}

// Compares bits, because a device may compare a NaN in any way. Negative zero counts as zero.
bool is_light(uint bits) { return bits <= floatBitsToUint(DECODE_BRIGHTEST) || bits == 0x80000000u; }
