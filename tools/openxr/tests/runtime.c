// A runtime of OpenXR without a display, for tests of the layer. It makes images of Vulkan, locates spaces with a fixed
// head, and checks what it receives. It prints a line that begins with "runtime:" and returns an error for a fault.
//
// NULL_RUNTIME_DEPTH=1 offers XR_KHR_composition_layer_depth. NULL_RUNTIME_PERIOD_US is the time of a frame.
// NULL_RUNTIME_NO_TRANSFER=1 refuses images that can be copied, as a runtime may.

#define _GNU_SOURCE
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <vulkan/vulkan.h>
#define XR_USE_GRAPHICS_API_VULKAN
#define XR_USE_TIMESPEC
#include <openxr/openxr.h>
#include <openxr/openxr_platform.h>
#include "negotiation.h"

#define COUNT(array) ((uint32_t)(sizeof(array) / sizeof *(array)))
enum { IMAGES = 3, EVENTS = 16 };
// The runtime's clock is ahead of the system's, so that a time that is not converted is wrong.
static const int64_t AHEAD_NS = 5000000000000;

typedef struct {
    XrReferenceSpaceType type;
    XrPosef pose;
} Space;

typedef struct {
    VkImage images[IMAGES];
    VkDeviceMemory memory[IMAGES];
    uint32_t count, next, held, released, width, height, layers;
} Swapchain;

static struct {
    VkInstance instance;
    VkPhysicalDevice physical;
    VkDevice device;
    VkQueue queue;
    uint32_t family;
    XrSessionState events[EVENTS];
    uint32_t first, last;
    int64_t due_ns;
    PFN_vkGetInstanceProcAddr get;
} state;

static XrResult fault(const char *text) {
    fprintf(stderr, "runtime: %s\n", text);
    return XR_ERROR_VALIDATION_FAILURE;
}

static int setting(const char *name) {
    const char *text = getenv(name);
    return text ? atoi(text) : 0;
}

static int64_t now_ns(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1000000000LL + now.tv_nsec;
}

static void event(XrSessionState next) { state.events[state.last++ % EVENTS] = next; }

// Poses.

static XrVector3f turn(XrQuaternionf q, XrVector3f v) {
    XrVector3f t = {2 * (q.y * v.z - q.z * v.y), 2 * (q.z * v.x - q.x * v.z), 2 * (q.x * v.y - q.y * v.x)};
    return (XrVector3f){v.x + q.w * t.x + q.y * t.z - q.z * t.y, v.y + q.w * t.y + q.z * t.x - q.x * t.z,
                        v.z + q.w * t.z + q.x * t.y - q.y * t.x};
}

static XrPosef after(XrPosef a, XrPosef b) {
    XrQuaternionf p = a.orientation, q = b.orientation;
    XrVector3f v = turn(p, b.position);
    return (XrPosef){{p.w * q.x + p.x * q.w + p.y * q.z - p.z * q.y, p.w * q.y - p.x * q.z + p.y * q.w + p.z * q.x,
                      p.w * q.z + p.x * q.y - p.y * q.x + p.z * q.w, p.w * q.w - p.x * q.x - p.y * q.y - p.z * q.z},
                     {v.x + a.position.x, v.y + a.position.y, v.z + a.position.z}};
}

static XrPosef inverse(XrPosef a) {
    XrQuaternionf q = {-a.orientation.x, -a.orientation.y, -a.orientation.z, a.orientation.w};
    XrVector3f v = turn(q, a.position);
    return (XrPosef){q, {-v.x, -v.y, -v.z}};
}

// The head is turned by 30 degrees to the left, and is not at the origin.
static XrPosef head(void) { return (XrPosef){{0, sinf(0.2617994f), 0, cosf(0.2617994f)}, {0.1f, 1.6f, -0.2f}}; }

static XrPosef in_world(const Space *space) {
    return space->type == XR_REFERENCE_SPACE_TYPE_VIEW ? after(head(), space->pose) : space->pose;
}

// Instances and systems.

static const char *const extensions[] = {"XR_KHR_vulkan_enable", "XR_KHR_vulkan_enable2", "XR_KHR_opengl_enable",
                                         "XR_KHR_convert_timespec_time", "XR_KHR_composition_layer_cylinder",
                                         "XR_KHR_composition_layer_depth"};

static uint32_t extension_count(void) { return COUNT(extensions) - !setting("NULL_RUNTIME_DEPTH"); }

static XrResult enumerate_extensions(const char *layer, uint32_t capacity, uint32_t *count, XrExtensionProperties *all) {
    (void)layer;
    *count = extension_count();
    for (uint32_t i = 0; i < *count && capacity; i++) {
        strcpy(all[i].extensionName, extensions[i]);
        all[i].extensionVersion = 6;
    }
    return XR_SUCCESS;
}

static XrResult create_instance(const XrInstanceCreateInfo *info, XrInstance *instance) {
    for (uint32_t i = 0; i < info->enabledExtensionCount; i++) {
        uint32_t known = 0;
        while (known < extension_count() && strcmp(info->enabledExtensionNames[i], extensions[known])) known++;
        if (known == extension_count()) {
            fault("an extension that it does not have");
            return XR_ERROR_EXTENSION_NOT_PRESENT;
        }
    }
    *instance = (XrInstance)(uintptr_t)0x1001;
    return XR_SUCCESS;
}

static XrResult destroy_instance(XrInstance instance) { return (void)instance, XR_SUCCESS; }

static XrResult instance_properties(XrInstance instance, XrInstanceProperties *properties) {
    (void)instance;
    strcpy(properties->runtimeName, "null");
    properties->runtimeVersion = 1;
    return XR_SUCCESS;
}

static XrResult poll_event(XrInstance instance, XrEventDataBuffer *data) {
    (void)instance;
    if (state.first == state.last) return XR_EVENT_UNAVAILABLE;
    XrEventDataSessionStateChanged changed = {XR_TYPE_EVENT_DATA_SESSION_STATE_CHANGED, NULL,
                                              (XrSession)(uintptr_t)0x2001, state.events[state.first++ % EVENTS], 0};
    memcpy(data, &changed, sizeof changed);
    return XR_SUCCESS;
}

static XrResult get_system(XrInstance instance, const XrSystemGetInfo *info, XrSystemId *system) {
    (void)instance, (void)info;
    return *system = 1, XR_SUCCESS;
}

static XrResult system_properties(XrInstance instance, XrSystemId system, XrSystemProperties *properties) {
    (void)instance;
    properties->systemId = system;
    properties->vendorId = 0;
    strcpy(properties->systemName, "null");
    properties->graphicsProperties = (XrSystemGraphicsProperties){4096, 4096, 16};
    properties->trackingProperties = (XrSystemTrackingProperties){1, 1};
    return XR_SUCCESS;
}

#define LIST(function, type, ...)                                                                \
    static XrResult function(XrInstance a, XrSystemId b, LIST_MORE uint32_t capacity, uint32_t *count, type *all) { \
        static const type values[] = {__VA_ARGS__};                                              \
        (void)a, (void)b;                                                                        \
        *count = COUNT(values);                                                                  \
        if (capacity) memcpy(all, values, sizeof values);                                        \
        return XR_SUCCESS;                                                                       \
    }
#define LIST_MORE
LIST(view_configurations, XrViewConfigurationType, XR_VIEW_CONFIGURATION_TYPE_PRIMARY_STEREO)
#undef LIST_MORE
#define LIST_MORE XrViewConfigurationType c,
#pragma GCC diagnostic ignored "-Wunused-parameter"
LIST(blend_modes, XrEnvironmentBlendMode, XR_ENVIRONMENT_BLEND_MODE_OPAQUE)
LIST(configuration_views, XrViewConfigurationView, {XR_TYPE_VIEW_CONFIGURATION_VIEW, NULL, 128, 4096, 128, 4096, 1, 1},
     {XR_TYPE_VIEW_CONFIGURATION_VIEW, NULL, 128, 4096, 128, 4096, 1, 1})

static XrResult configuration_properties(XrInstance instance, XrSystemId system, XrViewConfigurationType type,
                                         XrViewConfigurationProperties *properties) {
    properties->viewConfigurationType = type;
    return properties->fovMutable = XR_TRUE, XR_SUCCESS;
}

// Vulkan.

static XrResult requirements(XrInstance instance, XrSystemId system, XrGraphicsRequirementsVulkanKHR *needs) {
    needs->minApiVersionSupported = XR_MAKE_VERSION(1, 0, 0);
    return needs->maxApiVersionSupported = XR_MAKE_VERSION(1, 3, 0), XR_SUCCESS;
}

static XrResult list_text(const char *all, uint32_t capacity, uint32_t *count, char *text) {
    *count = (uint32_t)strlen(all) + 1;
    if (capacity && capacity < *count) return XR_ERROR_SIZE_INSUFFICIENT;
    if (capacity) strcpy(text, all);
    return XR_SUCCESS;
}

static XrResult instance_extensions(XrInstance instance, XrSystemId system, uint32_t capacity, uint32_t *count, char *text) {
    return list_text("VK_KHR_get_physical_device_properties2", capacity, count, text);
}

static XrResult device_extensions(XrInstance instance, XrSystemId system, uint32_t capacity, uint32_t *count, char *text) {
    return list_text("VK_KHR_maintenance1 VK_KHR_external_memory", capacity, count, text);
}

static XrResult graphics_device(XrInstance instance, XrSystemId system, VkInstance vulkan, VkPhysicalDevice *device) {
    uint32_t one = 1;
    VkResult found = vkEnumeratePhysicalDevices(vulkan, &one, device);
    return found == VK_SUCCESS || found == VK_INCOMPLETE ? XR_SUCCESS : XR_ERROR_RUNTIME_FAILURE;
}

static XrResult graphics_device2(XrInstance instance, const XrVulkanGraphicsDeviceGetInfoKHR *info, VkPhysicalDevice *device) {
    return graphics_device(instance, info->systemId, info->vulkanInstance, device);
}

static XrResult vulkan_instance(XrInstance instance, const XrVulkanInstanceCreateInfoKHR *info, VkInstance *made, VkResult *result) {
    *result = vkCreateInstance(info->vulkanCreateInfo, info->vulkanAllocator, made);
    return XR_SUCCESS;
}

static XrResult vulkan_device(XrInstance instance, const XrVulkanDeviceCreateInfoKHR *info, VkDevice *made, VkResult *result) {
    *result = vkCreateDevice(info->vulkanPhysicalDevice, info->vulkanCreateInfo, info->vulkanAllocator, made);
    return XR_SUCCESS;
}

// Sessions.

static XrResult create_session(XrInstance instance, const XrSessionCreateInfo *info, XrSession *session) {
    const XrGraphicsBindingVulkanKHR *binding = info->next;
    if (binding && binding->type == XR_TYPE_GRAPHICS_BINDING_VULKAN_KHR) {
        state.instance = binding->instance;
        state.physical = binding->physicalDevice;
        state.device = binding->device;
        state.family = binding->queueFamilyIndex;
        vkGetDeviceQueue(state.device, state.family, binding->queueIndex, &state.queue);
    }
    *session = (XrSession)(uintptr_t)0x2001;
    state.due_ns = 0;
    event(XR_SESSION_STATE_IDLE), event(XR_SESSION_STATE_READY);
    return XR_SUCCESS;
}

static XrResult destroy_session(XrSession session) { return XR_SUCCESS; }

static XrResult begin_session(XrSession session, const XrSessionBeginInfo *info) {
    event(XR_SESSION_STATE_SYNCHRONIZED), event(XR_SESSION_STATE_VISIBLE), event(XR_SESSION_STATE_FOCUSED);
    return XR_SUCCESS;
}

static XrResult end_session(XrSession session) { return event(XR_SESSION_STATE_IDLE), event(XR_SESSION_STATE_EXITING), XR_SUCCESS; }
static XrResult request_exit(XrSession session) { return event(XR_SESSION_STATE_STOPPING), XR_SUCCESS; }

static XrResult wait_frame(XrSession session, const XrFrameWaitInfo *info, XrFrameState *frame) {
    int64_t period = 1000LL * setting("NULL_RUNTIME_PERIOD_US"), now = now_ns();
    if (state.due_ns > now) {
        struct timespec until = {state.due_ns / 1000000000, state.due_ns % 1000000000};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL);
    }
    state.due_ns = (state.due_ns > now ? state.due_ns : now) + period;
    frame->predictedDisplayTime = state.due_ns + AHEAD_NS;
    frame->predictedDisplayPeriod = period;
    return frame->shouldRender = XR_TRUE, XR_SUCCESS;
}

static XrResult begin_frame(XrSession session, const XrFrameBeginInfo *info) { return XR_SUCCESS; }

static XrResult check_image(const XrSwapchainSubImage *image) {
    const Swapchain *chain = (const Swapchain *)image->swapchain;
    XrRect2Di r = image->imageRect;
    if (!chain->released) return fault("an image that was never released");
    if (r.offset.x < 0 || r.offset.y < 0 || r.offset.x + r.extent.width > (int32_t)chain->width ||
        r.offset.y + r.extent.height > (int32_t)chain->height || image->imageArrayIndex >= chain->layers)
        return fault("a part outside of the image");
    return XR_SUCCESS;
}

static XrResult end_frame(XrSession session, const XrFrameEndInfo *info) {
    for (uint32_t i = 0; i < info->layerCount; i++) {
        const XrCompositionLayerProjection *layer = (const void *)info->layers[i];
        if (layer->type == XR_TYPE_COMPOSITION_LAYER_QUAD) {
            if (check_image(&((const XrCompositionLayerQuad *)layer)->subImage)) return XR_ERROR_VALIDATION_FAILURE;
        }
        if (layer->type != XR_TYPE_COMPOSITION_LAYER_PROJECTION) continue;
        if (layer->viewCount != 2) return fault("views other than two");
        for (uint32_t v = 0; v < 2; v++) {
            const XrCompositionLayerProjectionView *view = &layer->views[v];
            if (check_image(&view->subImage)) return XR_ERROR_VALIDATION_FAILURE;
            const XrCompositionLayerDepthInfoKHR *depth = view->next;
            if (depth && depth->type == XR_TYPE_COMPOSITION_LAYER_DEPTH_INFO_KHR) {
                if (!setting("NULL_RUNTIME_DEPTH")) return fault("depth, which it does not have");
                if (check_image(&depth->subImage)) return XR_ERROR_VALIDATION_FAILURE;
            }
        }
    }
    return XR_SUCCESS;
}

// Spaces and views.

static XrResult reference_spaces(XrSession session, uint32_t capacity, uint32_t *count, XrReferenceSpaceType *all) {
    static const XrReferenceSpaceType types[] = {XR_REFERENCE_SPACE_TYPE_VIEW, XR_REFERENCE_SPACE_TYPE_LOCAL,
                                                 XR_REFERENCE_SPACE_TYPE_STAGE};
    *count = COUNT(types);
    if (capacity) memcpy(all, types, sizeof types);
    return XR_SUCCESS;
}

static XrResult make_space(XrReferenceSpaceType type, XrPosef pose, XrSpace *space) {
    Space *made = malloc(sizeof *made);
    *made = (Space){type, pose};
    return *space = (XrSpace)made, XR_SUCCESS;
}

static XrResult reference_space(XrSession session, const XrReferenceSpaceCreateInfo *info, XrSpace *space) {
    return make_space(info->referenceSpaceType, info->poseInReferenceSpace, space);
}

static XrResult action_space(XrSession session, const XrActionSpaceCreateInfo *info, XrSpace *space) {
    return make_space(XR_REFERENCE_SPACE_TYPE_LOCAL, info->poseInActionSpace, space);
}

static XrResult destroy_space(XrSpace space) { return free((void *)space), XR_SUCCESS; }

static XrResult locate_space(XrSpace space, XrSpace base, XrTime time, XrSpaceLocation *location) {
    if (time < AHEAD_NS) return XR_ERROR_TIME_INVALID;
    location->pose = after(inverse(in_world((Space *)base)), in_world((Space *)space));
    location->locationFlags = XR_SPACE_LOCATION_ORIENTATION_VALID_BIT | XR_SPACE_LOCATION_POSITION_VALID_BIT |
                              XR_SPACE_LOCATION_ORIENTATION_TRACKED_BIT | XR_SPACE_LOCATION_POSITION_TRACKED_BIT;
    return XR_SUCCESS;
}

static XrResult locate_views(XrSession session, const XrViewLocateInfo *info, XrViewState *views_state, uint32_t capacity,
                             uint32_t *count, XrView *views) {
    *count = 2;
    views_state->viewStateFlags = XR_VIEW_STATE_ORIENTATION_VALID_BIT | XR_VIEW_STATE_POSITION_VALID_BIT;
    for (int i = 0; i < 2 && capacity; i++) {
        XrPosef eye = {{0, 0, 0, 1}, {i ? 0.03f : -0.03f, 0, 0}};
        views[i].pose = after(inverse(in_world((Space *)info->space)), after(head(), eye));
        views[i].fov = (XrFovf){i ? -0.7f : -0.8f, i ? 0.8f : 0.7f, 0.75f, -0.65f};
    }
    return XR_SUCCESS;
}

// Swapchains.

static XrResult swapchain_formats(XrSession session, uint32_t capacity, uint32_t *count, int64_t *all) {
    static const int64_t formats[] = {VK_FORMAT_R8G8B8A8_SRGB,       VK_FORMAT_B8G8R8A8_SRGB,
                                      VK_FORMAT_R8G8B8A8_UNORM,      VK_FORMAT_R16G16B16A16_SFLOAT,
                                      VK_FORMAT_A2B10G10R10_UNORM_PACK32, VK_FORMAT_D32_SFLOAT,
                                      VK_FORMAT_D16_UNORM,           VK_FORMAT_D24_UNORM_S8_UINT};
    *count = COUNT(formats);
    if (capacity) memcpy(all, formats, sizeof formats);
    return XR_SUCCESS;
}

// Gives all images the layout in which an application receives them.
static void prepare(const Swapchain *chain, int is_depth, int has_stencil) {
    VkCommandPool pool;
    VkCommandBuffer commands;
    VkCommandPoolCreateInfo pool_info = {VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO, NULL, 0, state.family};
    vkCreateCommandPool(state.device, &pool_info, NULL, &pool);
    VkCommandBufferAllocateInfo info = {VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO, NULL, pool, 0, 1};
    vkAllocateCommandBuffers(state.device, &info, &commands);
    VkCommandBufferBeginInfo begin = {VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO, NULL, 0, NULL};
    vkBeginCommandBuffer(commands, &begin);
    VkImageAspectFlags aspect = is_depth ? VK_IMAGE_ASPECT_DEPTH_BIT : VK_IMAGE_ASPECT_COLOR_BIT;
    for (uint32_t i = 0; i < chain->count; i++) {
        VkImageMemoryBarrier barrier = {VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER, NULL, 0, VK_ACCESS_MEMORY_WRITE_BIT,
            VK_IMAGE_LAYOUT_UNDEFINED,
            is_depth ? VK_IMAGE_LAYOUT_DEPTH_STENCIL_ATTACHMENT_OPTIMAL : VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL,
            VK_QUEUE_FAMILY_IGNORED, VK_QUEUE_FAMILY_IGNORED, chain->images[i],
            {aspect | (has_stencil ? VK_IMAGE_ASPECT_STENCIL_BIT : 0), 0, 1, 0, VK_REMAINING_ARRAY_LAYERS}};
        vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_TOP_OF_PIPE_BIT, VK_PIPELINE_STAGE_ALL_COMMANDS_BIT, 0, 0, NULL,
                             0, NULL, 1, &barrier);
    }
    vkEndCommandBuffer(commands);
    VkSubmitInfo submit = {VK_STRUCTURE_TYPE_SUBMIT_INFO, NULL, 0, NULL, NULL, 1, &commands, 0, NULL};
    vkQueueSubmit(state.queue, 1, &submit, VK_NULL_HANDLE);
    vkQueueWaitIdle(state.queue);
    vkDestroyCommandPool(state.device, pool, NULL);
}

static XrResult create_swapchain(XrSession session, const XrSwapchainCreateInfo *info, XrSwapchain *swapchain) {
    VkFormat format = (VkFormat)info->format;
    int has_stencil = format == VK_FORMAT_D24_UNORM_S8_UINT;
    int is_depth = has_stencil || format == VK_FORMAT_D32_SFLOAT || format == VK_FORMAT_D16_UNORM;
    XrSwapchainUsageFlags asked = info->usageFlags;
    if (setting("NULL_RUNTIME_NO_TRANSFER") && asked & XR_SWAPCHAIN_USAGE_TRANSFER_SRC_BIT)
        return XR_ERROR_FEATURE_UNSUPPORTED;
    VkImageUsageFlags usage = VK_IMAGE_USAGE_SAMPLED_BIT |
        (is_depth ? VK_IMAGE_USAGE_DEPTH_STENCIL_ATTACHMENT_BIT : VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT) |
        (asked & XR_SWAPCHAIN_USAGE_TRANSFER_SRC_BIT ? VK_IMAGE_USAGE_TRANSFER_SRC_BIT : 0) |
        (asked & XR_SWAPCHAIN_USAGE_TRANSFER_DST_BIT ? VK_IMAGE_USAGE_TRANSFER_DST_BIT : 0);
    Swapchain *chain = calloc(1, sizeof *chain);
    chain->count = info->createFlags & XR_SWAPCHAIN_CREATE_STATIC_IMAGE_BIT ? 1 : IMAGES;
    chain->width = info->width, chain->height = info->height, chain->layers = info->arraySize;
    for (uint32_t i = 0; i < chain->count; i++) {
        VkImageCreateInfo image = {VK_STRUCTURE_TYPE_IMAGE_CREATE_INFO, NULL, 0, VK_IMAGE_TYPE_2D, format,
            {info->width, info->height, 1}, info->mipCount, info->arraySize, (VkSampleCountFlagBits)info->sampleCount,
            VK_IMAGE_TILING_OPTIMAL, usage, VK_SHARING_MODE_EXCLUSIVE, 0, NULL, VK_IMAGE_LAYOUT_UNDEFINED};
        if (vkCreateImage(state.device, &image, NULL, &chain->images[i])) return XR_ERROR_RUNTIME_FAILURE;
        VkMemoryRequirements needs;
        vkGetImageMemoryRequirements(state.device, chain->images[i], &needs);
        uint32_t type = 0;
        while (!(needs.memoryTypeBits >> type & 1)) type++;
        VkMemoryAllocateInfo memory = {VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, NULL, needs.size, type};
        if (vkAllocateMemory(state.device, &memory, NULL, &chain->memory[i])) return XR_ERROR_RUNTIME_FAILURE;
        vkBindImageMemory(state.device, chain->images[i], chain->memory[i], 0);
    }
    prepare(chain, is_depth, has_stencil);
    return *swapchain = (XrSwapchain)chain, XR_SUCCESS;
}

static XrResult destroy_swapchain(XrSwapchain swapchain) {
    Swapchain *chain = (Swapchain *)swapchain;
    for (uint32_t i = 0; i < chain->count; i++) {
        vkDestroyImage(state.device, chain->images[i], NULL);
        vkFreeMemory(state.device, chain->memory[i], NULL);
    }
    free(chain);
    return XR_SUCCESS;
}

static XrResult swapchain_images(XrSwapchain swapchain, uint32_t capacity, uint32_t *count, XrSwapchainImageBaseHeader *all) {
    const Swapchain *chain = (const Swapchain *)swapchain;
    *count = chain->count;
    for (uint32_t i = 0; i < chain->count && capacity; i++) ((XrSwapchainImageVulkanKHR *)all)[i].image = chain->images[i];
    return XR_SUCCESS;
}

static XrResult acquire_image(XrSwapchain swapchain, const XrSwapchainImageAcquireInfo *info, uint32_t *index) {
    Swapchain *chain = (Swapchain *)swapchain;
    if (chain->held == chain->count) return XR_ERROR_CALL_ORDER_INVALID;
    chain->held++;
    *index = chain->next;
    chain->next = (chain->next + 1) % chain->count;
    return XR_SUCCESS;
}

static XrResult wait_image(XrSwapchain swapchain, const XrSwapchainImageWaitInfo *info) { return XR_SUCCESS; }

static XrResult release_image(XrSwapchain swapchain, const XrSwapchainImageReleaseInfo *info) {
    Swapchain *chain = (Swapchain *)swapchain;
    if (!chain->held) return XR_ERROR_CALL_ORDER_INVALID;
    chain->held--;
    return chain->released = 1, XR_SUCCESS;
}

// Times.

static XrResult to_timespec(XrInstance instance, XrTime time, struct timespec *converted) {
    int64_t ns = time - AHEAD_NS;
    *converted = (struct timespec){ns / 1000000000, ns % 1000000000};
    return XR_SUCCESS;
}

static XrResult from_timespec(XrInstance instance, const struct timespec *time, XrTime *converted) {
    return *converted = time->tv_sec * 1000000000LL + time->tv_nsec + AHEAD_NS, XR_SUCCESS;
}

// Actions, which no test reads. A handle or a path is any number but 0.

static uint64_t numbers = 0x3000;
static XrResult string_to_path(XrInstance instance, const char *text, XrPath *path) { return *path = ++numbers, XR_SUCCESS; }
static XrResult path_to_string(XrInstance instance, XrPath path, uint32_t capacity, uint32_t *count, char *text) {
    if (capacity >= 2) strcpy(text, "/");
    return *count = 2, XR_SUCCESS;
}
static XrResult action_set(XrInstance instance, const XrActionSetCreateInfo *info, XrActionSet *set) {
    return *set = (XrActionSet)(uintptr_t)++numbers, XR_SUCCESS;
}
static XrResult create_action(XrActionSet set, const XrActionCreateInfo *info, XrAction *action) {
    return *action = (XrAction)(uintptr_t)++numbers, XR_SUCCESS;
}
static XrResult destroy_action(XrAction action) { return XR_SUCCESS; }
static XrResult destroy_action_set(XrActionSet set) { return XR_SUCCESS; }
static XrResult suggest(XrInstance instance, const XrInteractionProfileSuggestedBinding *bindings) { return XR_SUCCESS; }
static XrResult attach(XrSession session, const XrSessionActionSetsAttachInfo *info) { return XR_SUCCESS; }
static XrResult sync_actions(XrSession session, const XrActionsSyncInfo *info) { return XR_SUCCESS; }
static XrResult action_state(XrSession session, const XrActionStateGetInfo *info, XrActionStateFloat *found) {
    return found->isActive = XR_FALSE, XR_SUCCESS;
}
static XrResult boolean_state(XrSession session, const XrActionStateGetInfo *info, XrActionStateBoolean *found) {
    return found->isActive = XR_FALSE, XR_SUCCESS;
}
static XrResult pose_state(XrSession session, const XrActionStateGetInfo *info, XrActionStatePose *found) {
    return found->isActive = XR_FALSE, XR_SUCCESS;
}
static XrResult bound_sources(XrSession session, const XrBoundSourcesForActionEnumerateInfo *info, uint32_t capacity,
                              uint32_t *count, XrPath *all) {
    return *count = 0, XR_SUCCESS;
}

static XrResult get(XrInstance instance, const char *name, PFN_xrVoidFunction *function) {
    static const struct {
        const char *name;
        PFN_xrVoidFunction function;
    } all[] = {
#define ENTRY(name, function) {name, (PFN_xrVoidFunction)(function)}
        ENTRY("xrGetInstanceProcAddr", get),
        ENTRY("xrEnumerateInstanceExtensionProperties", enumerate_extensions),
        ENTRY("xrCreateInstance", create_instance),
        ENTRY("xrDestroyInstance", destroy_instance),
        ENTRY("xrGetInstanceProperties", instance_properties),
        ENTRY("xrPollEvent", poll_event),
        ENTRY("xrGetSystem", get_system),
        ENTRY("xrGetSystemProperties", system_properties),
        ENTRY("xrEnumerateEnvironmentBlendModes", blend_modes),
        ENTRY("xrEnumerateViewConfigurations", view_configurations),
        ENTRY("xrGetViewConfigurationProperties", configuration_properties),
        ENTRY("xrEnumerateViewConfigurationViews", configuration_views),
        ENTRY("xrGetVulkanGraphicsRequirementsKHR", requirements),
        ENTRY("xrGetVulkanGraphicsRequirements2KHR", requirements),
        ENTRY("xrGetVulkanInstanceExtensionsKHR", instance_extensions),
        ENTRY("xrGetVulkanDeviceExtensionsKHR", device_extensions),
        ENTRY("xrGetVulkanGraphicsDeviceKHR", graphics_device),
        ENTRY("xrGetVulkanGraphicsDevice2KHR", graphics_device2),
        ENTRY("xrCreateVulkanInstanceKHR", vulkan_instance),
        ENTRY("xrCreateVulkanDeviceKHR", vulkan_device),
        ENTRY("xrCreateSession", create_session),
        ENTRY("xrDestroySession", destroy_session),
        ENTRY("xrBeginSession", begin_session),
        ENTRY("xrEndSession", end_session),
        ENTRY("xrRequestExitSession", request_exit),
        ENTRY("xrWaitFrame", wait_frame),
        ENTRY("xrBeginFrame", begin_frame),
        ENTRY("xrEndFrame", end_frame),
        ENTRY("xrEnumerateReferenceSpaces", reference_spaces),
        ENTRY("xrCreateReferenceSpace", reference_space),
        ENTRY("xrCreateActionSpace", action_space),
        ENTRY("xrDestroySpace", destroy_space),
        ENTRY("xrLocateSpace", locate_space),
        ENTRY("xrLocateViews", locate_views),
        ENTRY("xrEnumerateSwapchainFormats", swapchain_formats),
        ENTRY("xrCreateSwapchain", create_swapchain),
        ENTRY("xrDestroySwapchain", destroy_swapchain),
        ENTRY("xrEnumerateSwapchainImages", swapchain_images),
        ENTRY("xrAcquireSwapchainImage", acquire_image),
        ENTRY("xrWaitSwapchainImage", wait_image),
        ENTRY("xrReleaseSwapchainImage", release_image),
        ENTRY("xrConvertTimeToTimespecTimeKHR", to_timespec),
        ENTRY("xrConvertTimespecTimeToTimeKHR", from_timespec),
        ENTRY("xrStringToPath", string_to_path),
        ENTRY("xrPathToString", path_to_string),
        ENTRY("xrCreateActionSet", action_set),
        ENTRY("xrDestroyActionSet", destroy_action_set),
        ENTRY("xrCreateAction", create_action),
        ENTRY("xrDestroyAction", destroy_action),
        ENTRY("xrSuggestInteractionProfileBindings", suggest),
        ENTRY("xrAttachSessionActionSets", attach),
        ENTRY("xrSyncActions", sync_actions),
        ENTRY("xrGetActionStateFloat", action_state),
        ENTRY("xrGetActionStateBoolean", boolean_state),
        ENTRY("xrGetActionStatePose", pose_state),
        ENTRY("xrEnumerateBoundSourcesForAction", bound_sources),
    };
    for (uint32_t i = 0; i < COUNT(all); i++) {
        if (!strcmp(name, all[i].name)) return *function = all[i].function, XR_SUCCESS;
    }
    return *function = NULL, XR_ERROR_FUNCTION_UNSUPPORTED;
}

__attribute__((visibility("default"))) XrResult xrNegotiateLoaderRuntimeInterface(const XrNegotiateLoaderInfo *loader,
                                                                                 XrNegotiateRuntimeRequest *request) {
    (void)loader;
    request->runtimeInterfaceVersion = 1;
    request->runtimeApiVersion = XR_MAKE_VERSION(1, 0, 20);
    request->getInstanceProcAddr = get;
    return XR_SUCCESS;
}
