// A Vulkan driver that poses as a discrete GPU, for tests on machines without one.
//
// It forwards every call to lavapipe, and changes the properties in which a discrete GPU differs from software. These
// are the kind of device, the kinds of memory, the alignment of buffers, and the content of new memory. It is a driver
// and not a layer, because the loader puts layers of the environment above the validation layer that a program
// requests. The validation layer would then check against lavapipe's limits, and not against the limits of the GPU.
//
// EYEBOX_POSING_LIMITS sets limits, for example "maxComputeSharedMemorySize=16384 maxComputeWorkGroupCount[1]=64".
// The names are Vulkan's, and the names of `heaps` below. tools/posing.sh compiles and installs the driver.

#include <dlfcn.h>
#include <pthread.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <vulkan/vk_icd.h>
#include <vulkan/vulkan.h>

#define COUNT(array) (sizeof(array) / sizeof *(array))
#define EXPORT __attribute__((visibility("default")))

// Limits.

// The offset alignment and the unit of a buffer's size on NVIDIA's GPUs are 256 bytes or less.
enum { ALIGNMENT = 256 };

#define LIMIT(name) {#name, offsetof(VkPhysicalDeviceLimits, name), sizeof((VkPhysicalDeviceLimits *)0)->name}
static const struct {
    const char *name;
    size_t offset, size;
} limits[] = {
    LIMIT(maxComputeSharedMemorySize),
    LIMIT(maxComputeWorkGroupCount[0]),
    LIMIT(maxComputeWorkGroupCount[1]),
    LIMIT(maxComputeWorkGroupCount[2]),
    LIMIT(maxComputeWorkGroupInvocations),
    LIMIT(maxComputeWorkGroupSize[0]),
    LIMIT(maxComputeWorkGroupSize[1]),
    LIMIT(maxPerStageDescriptorStorageBuffers),
    LIMIT(maxStorageBufferRange),
    LIMIT(minStorageBufferOffsetAlignment),
};
static const char ALLOCATION[] = "maxMemoryAllocationSize";
static const char *const heaps[] = {"deviceHeap", "hostHeap", "windowHeap"};

// Finds "name=number" in EYEBOX_POSING_LIMITS.
static int setting(const char *name, uint64_t *value) {
    const char *text = getenv("EYEBOX_POSING_LIMITS");
    for (size_t length = strlen(name); text && *text; text += strcspn(text, " \n"), text += strspn(text, " \n")) {
        if (!strncmp(text, name, length) && text[length] == '=') {
            *value = strtoull(text + length + 1, NULL, 0);
            return 1;
        }
    }
    return 0;
}

// Counts the settings that have no effect, because a misspelled limit would let a test pass for nothing.
static int unknown_settings(void) {
    const char *text = getenv("EYEBOX_POSING_LIMITS");
    int given = 0, known = 0;
    uint64_t value;
    for (; text && *text; text += strcspn(text, " \n"), text += strspn(text, " \n")) given++;
    for (size_t i = 0; i < COUNT(limits); i++) known += setting(limits[i].name, &value);
    for (size_t i = 0; i < COUNT(heaps); i++) known += setting(heaps[i], &value);
    return given - known - setting(ALLOCATION, &value);
}

// Functions of lavapipe that are replaced. `next_NAME` is lavapipe's own.

#define REPLACED(_) \
    _(vkGetDeviceProcAddr) _(vkGetPhysicalDeviceProperties) _(vkGetPhysicalDeviceProperties2) \
    _(vkGetPhysicalDeviceMemoryProperties) _(vkGetPhysicalDeviceMemoryProperties2) _(vkGetBufferMemoryRequirements) \
    _(vkGetBufferMemoryRequirements2) _(vkAllocateMemory) _(vkFreeMemory) _(vkMapMemory) _(vkWaitSemaphores)
#define NEXT(name) static PFN_##name next_##name;
REPLACED(NEXT)

// Properties.

static void pose(VkPhysicalDeviceProperties *properties) {
    properties->deviceType = VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU;
    snprintf(properties->deviceName, sizeof properties->deviceName, "Posing GPU");
    properties->limits.minStorageBufferOffsetAlignment = ALIGNMENT;
    properties->limits.minUniformBufferOffsetAlignment = ALIGNMENT;
    for (size_t i = 0; i < COUNT(limits); i++) {
        uint64_t value;
        if (!setting(limits[i].name, &value)) continue;
        char *limit = (char *)&properties->limits + limits[i].offset;
        if (limits[i].size == sizeof(uint64_t)) memcpy(limit, &value, sizeof value);
        else memcpy(limit, &(uint32_t){(uint32_t)value}, sizeof(uint32_t));
    }
}

static VKAPI_ATTR void VKAPI_CALL my_vkGetPhysicalDeviceProperties(VkPhysicalDevice device,
                                                                   VkPhysicalDeviceProperties *properties) {
    next_vkGetPhysicalDeviceProperties(device, properties);
    pose(properties);
}

static VKAPI_ATTR void VKAPI_CALL my_vkGetPhysicalDeviceProperties2(VkPhysicalDevice device,
                                                                    VkPhysicalDeviceProperties2 *properties) {
    next_vkGetPhysicalDeviceProperties2(device, properties);
    pose(&properties->properties);
    uint64_t most;
    if (!setting(ALLOCATION, &most)) return;
    for (VkBaseOutStructure *at = properties->pNext; at; at = at->pNext) {
        if (at->sType == VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MAINTENANCE_3_PROPERTIES)
            ((VkPhysicalDeviceMaintenance3Properties *)at)->maxMemoryAllocationSize = most;
        if (at->sType == VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_1_PROPERTIES)
            ((VkPhysicalDeviceVulkan11Properties *)at)->maxMemoryAllocationSize = most;
    }
}

// Memory. NVIDIA's driver has these types in this order. The first has no property. The next are the device's alone,
// the host's without and with cache, and a window of the device's memory that the host maps.

#define HOST (VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT)
static const VkMemoryType types[] = {
    {0, 1},
    {VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT, 0},
    {HOST, 1},
    {HOST | VK_MEMORY_PROPERTY_HOST_CACHED_BIT, 1},
    {HOST | VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT, 2},
};

struct allocation {
    VkDeviceMemory memory;
    VkDeviceSize size;
    uint32_t type;
    struct allocation *next;
};
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static struct allocation *allocations;
static VkDeviceSize sizes[COUNT(heaps)], used[COUNT(heaps)];

static void pose_memory(VkPhysicalDeviceMemoryProperties *memory) {
    // These are the heaps of a GPU of 8 GiB without a resizable BAR. Lavapipe reports 2 GiB, but sets no limit.
    VkDeviceSize all[] = {8ull << 30, 8ull << 30, 214 << 20};
    for (size_t i = 0; i < COUNT(heaps); i++) setting(heaps[i], &all[i]);
    *memory = (VkPhysicalDeviceMemoryProperties){.memoryTypeCount = COUNT(types), .memoryHeapCount = COUNT(heaps)};
    memcpy(memory->memoryTypes, types, sizeof types);
    for (size_t i = 0; i < COUNT(heaps); i++)
        memory->memoryHeaps[i] = (VkMemoryHeap){all[i], i == 1 ? 0 : VK_MEMORY_HEAP_DEVICE_LOCAL_BIT};
    pthread_mutex_lock(&lock);
    memcpy(sizes, all, sizeof sizes);
    pthread_mutex_unlock(&lock);
}

static VKAPI_ATTR void VKAPI_CALL my_vkGetPhysicalDeviceMemoryProperties(VkPhysicalDevice device,
                                                                         VkPhysicalDeviceMemoryProperties *memory) {
    next_vkGetPhysicalDeviceMemoryProperties(device, memory);
    pose_memory(memory);
}

static VKAPI_ATTR void VKAPI_CALL my_vkGetPhysicalDeviceMemoryProperties2(VkPhysicalDevice device,
                                                                          VkPhysicalDeviceMemoryProperties2 *memory) {
    next_vkGetPhysicalDeviceMemoryProperties2(device, memory);
    pose_memory(&memory->memoryProperties);
}

static void pose_requirements(VkMemoryRequirements *needs) {
    needs->memoryTypeBits = (1u << COUNT(types)) - 1;
    needs->alignment = needs->alignment > ALIGNMENT ? needs->alignment : ALIGNMENT;
    needs->size = (needs->size + needs->alignment - 1) / needs->alignment * needs->alignment;
}

static VKAPI_ATTR void VKAPI_CALL my_vkGetBufferMemoryRequirements(VkDevice device, VkBuffer buffer,
                                                                   VkMemoryRequirements *needs) {
    next_vkGetBufferMemoryRequirements(device, buffer, needs);
    pose_requirements(needs);
}

static VKAPI_ATTR void VKAPI_CALL my_vkGetBufferMemoryRequirements2(VkDevice device,
                                                                    const VkBufferMemoryRequirementsInfo2 *info,
                                                                    VkMemoryRequirements2 *needs) {
    next_vkGetBufferMemoryRequirements2(device, info, needs);
    pose_requirements(&needs->memoryRequirements);
}

// Fills memory with 0xff, which is not a number in float32 and in float16. Lavapipe's new memory is zero, so a kernel
// that reads what nobody wrote gives plausible results there.
static void poison(VkDevice device, VkDeviceMemory memory, VkDeviceSize size) {
    void *bytes;
    if (next_vkMapMemory(device, memory, 0, VK_WHOLE_SIZE, 0, &bytes) != VK_SUCCESS) return;
    memset(bytes, 0xff, size);
    ((PFN_vkUnmapMemory)next_vkGetDeviceProcAddr(device, "vkUnmapMemory"))(device, memory);
}

static VKAPI_ATTR VkResult VKAPI_CALL my_vkAllocateMemory(VkDevice device, const VkMemoryAllocateInfo *info,
                                                          const VkAllocationCallbacks *callbacks,
                                                          VkDeviceMemory *memory) {
    uint32_t heap = types[info->memoryTypeIndex].heapIndex;
    uint64_t most = info->allocationSize;
    setting(ALLOCATION, &most);
    struct allocation *made = malloc(sizeof *made);
    if (!made) return VK_ERROR_OUT_OF_HOST_MEMORY;
    *made = (struct allocation){.size = info->allocationSize, .type = info->memoryTypeIndex};
    pthread_mutex_lock(&lock);
    int fits = made->size <= most && made->size <= sizes[heap] - used[heap];
    if (fits) used[heap] += made->size;
    pthread_mutex_unlock(&lock);
    VkMemoryAllocateInfo own = *info;
    own.memoryTypeIndex = 0; // Lavapipe has one type, which has all properties.
    VkResult result = fits ? next_vkAllocateMemory(device, &own, callbacks, memory) : VK_ERROR_OUT_OF_DEVICE_MEMORY;
    pthread_mutex_lock(&lock);
    if (result == VK_SUCCESS) {
        made->memory = *memory;
        made->next = allocations;
        allocations = made;
    } else if (fits) {
        used[heap] -= made->size;
    }
    pthread_mutex_unlock(&lock);
    if (result != VK_SUCCESS) {
        free(made);
        return result;
    }
    int imported = 0;
    for (const VkBaseInStructure *at = info->pNext; at; at = at->pNext)
        imported |= at->sType == VK_STRUCTURE_TYPE_IMPORT_MEMORY_FD_INFO_KHR;
    if (!imported) poison(device, *memory, info->allocationSize);
    return VK_SUCCESS;
}

static VKAPI_ATTR void VKAPI_CALL my_vkFreeMemory(VkDevice device, VkDeviceMemory memory,
                                                  const VkAllocationCallbacks *callbacks) {
    pthread_mutex_lock(&lock);
    struct allocation **at = &allocations;
    while (*at && (*at)->memory != memory) at = &(*at)->next;
    struct allocation *found = *at;
    if (found) {
        used[types[found->type].heapIndex] -= found->size;
        *at = found->next;
    }
    pthread_mutex_unlock(&lock);
    free(found);
    next_vkFreeMemory(device, memory, callbacks);
}

static VKAPI_ATTR VkResult VKAPI_CALL my_vkMapMemory(VkDevice device, VkDeviceMemory memory, VkDeviceSize offset,
                                                     VkDeviceSize size, VkMemoryMapFlags flags, void **bytes) {
    pthread_mutex_lock(&lock);
    const struct allocation *at = allocations;
    while (at && at->memory != memory) at = at->next;
    int visible = at && types[at->type].propertyFlags & VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT;
    pthread_mutex_unlock(&lock);
    if (visible) return next_vkMapMemory(device, memory, offset, size, flags, bytes);
    fprintf(stderr, "posing: a program mapped memory that the host cannot map\n");
    return VK_ERROR_MEMORY_MAP_FAILED;
}

// Waits longer than the program asks for. eyebox gives up a GPU that does not answer for seconds, but lavapipe takes
// more to compile a kernel, which it does at the first dispatch.
static VKAPI_ATTR VkResult VKAPI_CALL my_vkWaitSemaphores(VkDevice device, const VkSemaphoreWaitInfo *info,
                                                          uint64_t nanoseconds) {
    const uint64_t second = 1000000000, minutes = 600 * second;
    return next_vkWaitSemaphores(device, info,
                                 nanoseconds < second || nanoseconds > minutes ? nanoseconds : minutes);
}

// The interface of drivers.

static PFN_vkVoidFunction replace(const char *name, PFN_vkVoidFunction next);

static VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL my_vkGetDeviceProcAddr(VkDevice device, const char *name) {
    return replace(name, next_vkGetDeviceProcAddr(device, name));
}

// Keeps lavapipe's function and returns the replacement, if there is one. A name that ends in KHR is the same function.
static PFN_vkVoidFunction replace(const char *name, PFN_vkVoidFunction next) {
    size_t length = strlen(name);
    if (length > 3 && !strcmp(name + length - 3, "KHR")) length -= 3;
#define REPLACE(replaced) \
    if (next && length == strlen(#replaced) && !strncmp(name, #replaced, length)) { \
        next_##replaced = (PFN_##replaced)next; \
        return (PFN_vkVoidFunction)my_##replaced; \
    }
    REPLACED(REPLACE)
    return next;
}

static void *lavapipe(const char *name) {
    static void *library;
    if (!library) library = dlopen("libvulkan_lvp.so", RTLD_NOW | RTLD_LOCAL);
    return library ? dlsym(library, name) : NULL;
}

EXPORT VKAPI_ATTR VkResult VKAPI_CALL vk_icdNegotiateLoaderICDInterfaceVersion(uint32_t *version) {
    PFN_vkNegotiateLoaderICDInterfaceVersion next;
    next = (PFN_vkNegotiateLoaderICDInterfaceVersion)lavapipe("vk_icdNegotiateLoaderICDInterfaceVersion");
    int unknown = unknown_settings();
    if (!next) fprintf(stderr, "posing: libvulkan_lvp.so, which is Mesa's lavapipe, was not found\n");
    if (unknown) fprintf(stderr, "posing: %d settings of EYEBOX_POSING_LIMITS are unknown or double\n", unknown);
    return next && !unknown ? next(version) : VK_ERROR_INCOMPATIBLE_DRIVER;
}

EXPORT VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL vk_icdGetInstanceProcAddr(VkInstance instance, const char *name) {
    PFN_vkGetInstanceProcAddr next = (PFN_vkGetInstanceProcAddr)lavapipe("vk_icdGetInstanceProcAddr");
    return next ? replace(name, next(instance, name)) : NULL;
}

EXPORT VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL vk_icdGetPhysicalDeviceProcAddr(VkInstance instance, const char *name) {
    PFN_vkGetInstanceProcAddr next = (PFN_vkGetInstanceProcAddr)lavapipe("vk_icdGetPhysicalDeviceProcAddr");
    return next ? replace(name, next(instance, name)) : NULL;
}
