// Phases in memory: float32, or where ANGLES is 1 binary angles of 16 bits, two in a word, the velocities beside them halves:
// see binary_angle.rs. Only where fields are halves as well. ANGLES_ID: the constant that says so.

#ifdef HALF
layout(constant_id = ANGLES_ID) const uint ANGLES = 0;
#else
#define ANGLES 0u
#endif

// The phase of an angle, in the low bits.
float angle_value(uint bits) { return float(int(bits << 16) >> 16) * ANGLE_UNIT; }

// Of a buffer of words, phase i.
#define PHASE_AT(buffer, i) \
    (ANGLES == 1u ? angle_value(buffer[(i) / 2u] >> (16u * ((i) & 1u))) : uintBitsToFloat(buffer[i]))
