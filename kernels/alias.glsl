// Buffers of a kernel that may lie in the same memory, one of them being written: what a compiler may else take for granted
// does not hold (SPIR-V, `Aliased`).

#extension GL_EXT_spirv_intrinsics : require
#define MAY_ALIAS spirv_decorate(20)
