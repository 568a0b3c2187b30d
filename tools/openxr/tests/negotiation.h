// The structures between OpenXR's loader and a runtime. Debian's package has no header for them.

#ifndef NEGOTIATION_H
#define NEGOTIATION_H

#include <openxr/openxr.h>
#include <stddef.h>

typedef struct {
    int32_t structType;
    uint32_t structVersion;
    size_t structSize;
    uint32_t minInterfaceVersion, maxInterfaceVersion;
    XrVersion minApiVersion, maxApiVersion;
} XrNegotiateLoaderInfo;

typedef struct {
    int32_t structType;
    uint32_t structVersion;
    size_t structSize;
    uint32_t runtimeInterfaceVersion;
    XrVersion runtimeApiVersion;
    PFN_xrGetInstanceProcAddr getInstanceProcAddr;
} XrNegotiateRuntimeRequest;

#endif
