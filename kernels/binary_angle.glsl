// Phases in memory are float32. If ANGLES is 1, they are binary angles of 16 bits, two in a word, and velocities are
// halves (see binary_angle.rs). Fields are then halves as well. ANGLES_ID is the number of the constant ANGLES.

#ifdef HALF
layout(constant_id = ANGLES_ID) const uint ANGLES = 0;
#else
#define ANGLES 0u
#endif

// Returns the phase of the angle in the low bits.
float angle_value(uint bits) { return float(int(bits << 16) >> 16) * ANGLE_UNIT; }

// Reads phase i of a buffer of words.
#define PHASE_AT(buffer, i) \
    (ANGLES == 1u ? angle_value(buffer[(i) / 2u] >> (16u * ((i) & 1u))) : uintBitsToFloat(buffer[i]))
