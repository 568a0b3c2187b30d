// Drives and their gradients in memory are float32. If fields are halves, they are halves too, two in a word (see
// half.rs). A value beyond the range of a half becomes the largest half. DRIVES is the element type of a buffer.
// DRIVES_OUT qualifies a buffer that a shader only writes.

#ifdef HALF
#define DRIVES uint
// The qualifier is empty, because a write of half a word also reads the other half.
#define DRIVES_OUT
uint drive_bits(float x) { return half_bits(clamp(x, -65504.0, 65504.0)); }
// Reads value i of a buffer.
#define DRIVE_AT(buffer, i) half_unpack(buffer[(i) / 2u])[(i) & 1u]
// The other half of the word may belong to another invocation.
#define PUT_DRIVE(buffer, i, x) \
    { \
        uint shift_ = 16u * ((i) & 1u); \
        atomicAnd(buffer[(i) / 2u], ~(0xffffu << shift_)); \
        atomicOr(buffer[(i) / 2u], drive_bits(x) << shift_); \
    }
// Writes values i and i + 1, for an even i.
#define PUT_DRIVES(buffer, i, x, y) buffer[(i) / 2u] = drive_bits(x) | (drive_bits(y) << 16)
#else
#define DRIVES float
#define DRIVES_OUT writeonly
#define DRIVE_AT(buffer, i) buffer[i]
#define PUT_DRIVE(buffer, i, x) buffer[i] = x
#define PUT_DRIVES(buffer, i, x, y) { buffer[i] = x; buffer[(i) + 1u] = y; }
#endif
