// MAY_ALIAS marks buffers of a kernel that may share memory if one of them is written. A compiler must then not assume
// that they are separate (SPIR-V, `Aliased`).

#extension GL_EXT_spirv_intrinsics : require
#define MAY_ALIAS spirv_decorate(20)
