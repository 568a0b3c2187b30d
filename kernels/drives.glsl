// Drives in memory, and what is asked of them on their way back: float32, or where fields are halves, halves, two in a word (see
// half.rs). What is beyond a half's range is the largest. DRIVES is what a buffer holds, DRIVES_OUT how one is declared that is
// only written.

#ifdef HALF
#define DRIVES uint
// Half a word is written by reading the other half.
#define DRIVES_OUT
uint drive_bits(float x) { return half_bits(clamp(x, -65504.0, 65504.0)); }
// Of a buffer, value i.
#define DRIVE_AT(buffer, i) half_unpack(buffer[(i) / 2u])[(i) & 1u]
// The other half of the word may be another invocation's.
#define PUT_DRIVE(buffer, i, x) \
    { \
        uint shift_ = 16u * ((i) & 1u); \
        atomicAnd(buffer[(i) / 2u], ~(0xffffu << shift_)); \
        atomicOr(buffer[(i) / 2u], drive_bits(x) << shift_); \
    }
// Values i and i + 1, of which i is even.
#define PUT_DRIVES(buffer, i, x, y) buffer[(i) / 2u] = drive_bits(x) | (drive_bits(y) << 16)
#else
#define DRIVES float
#define DRIVES_OUT writeonly
#define DRIVE_AT(buffer, i) buffer[i]
#define PUT_DRIVE(buffer, i, x) buffer[i] = x
#define PUT_DRIVES(buffer, i, x, y) { buffer[i] = x; buffer[(i) + 1u] = y; }
#endif
