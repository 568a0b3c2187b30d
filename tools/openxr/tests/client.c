// An OpenXR application for tests of the layer. It renders pictures whose every pixel follows from the number of the
// frame, through images of Vulkan, and does not wait for its device.
//
// Arguments are KEY=VALUE.
//
// With frames=N, a session has N frames. With sessions=N, N sessions follow each other. With size=WxH, a view has W x H
// pixels. With tangent=T, the edges of a view have this tangent. With layout=array, an image has a layer per eye. With
// layout=wide, the eyes are side by side. The words color=NAME take srgb, unorm, bgra, half or ten. The words depth=NAME
// take none, d16, d24 or d32. With near=M and far=M, depths 0 and 1 have these distances. With samples=N, a color image
// has N samples. The words show=NAMES list layers (projection, quad, view-quad, cylinder). With resize=N, views are half
// as large from frame N on. With pause=A-B, these frames have no layers. With die=N, the process is killed at frame N.
// With noise=1, a second thread submits. With graphics=gl, a session begins for OpenGL. With panel=once, the image of
// the panel is released once. With start=line, the first frame waits for a line on the standard input. With extensions=none, the application ignores the extensions that it should enable. With
// extensions=made, OpenXR makes its instance and its device. With vulkan=1.0, it uses this version.
//
// At the end it prints the frames, the size of its memory after a quarter of them and at the end (KiB), and the mean
// time of a frame (us).

#define _GNU_SOURCE
#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>
#include <vulkan/vulkan.h>
#define XR_USE_GRAPHICS_API_VULKAN
#include <openxr/openxr.h>
#include <openxr/openxr_platform.h>

#define CHECK(call)                                                       \
    do {                                                                  \
        long checked = (long)(call);                                     \
        if (checked < 0) {                                                \
            fprintf(stderr, "client: %s is %ld\n", #call, checked);       \
            exit(1);                                                      \
        }                                                                 \
    } while (0)
enum { IMAGES = 3 };
// An endless wait runs without a pause on lavapipe 22.3, and may starve the thread that signals the fence.
static const uint64_t PATIENCE_NS = 20000000000;

static int words;
static char **word;

static const char *text(const char *key, const char *usual) {
    size_t length = strlen(key);
    for (int i = words - 1; i > 0; i--)
        if (!strncmp(word[i], key, length) && word[i][length] == '=') return word[i] + length + 1;
    return usual;
}

static int number(const char *key, int usual) { return atoi(text(key, "")) ? atoi(text(key, "")) : usual; }
static float real(const char *key, const char *usual) { return strtof(text(key, usual), NULL); }
static int shows(const char *name) { return strstr(text("show", "projection"), name) != NULL; }

static VkInstance instance;
static VkPhysicalDevice physical;
static VkDevice device;
static VkQueue queue;
static XrInstance xr;
static XrSystemId system_id;
static XrSession session;
static XrSpace local, view_space;
// The queue is shared with a second thread. OpenXR's calls that may submit are inside of it, too.
static pthread_mutex_t queue_lock = PTHREAD_MUTEX_INITIALIZER;
static volatile int runs;

// An image with what fills it.
typedef struct {
    XrSwapchain chain;
    uint32_t width, height, layers, texel;
    int64_t format;
    VkImageAspectFlags aspect;
    VkImage images[IMAGES];
    VkBuffer buffers[IMAGES];
    VkDeviceMemory memory[IMAGES];
    uint8_t *mapped[IMAGES];
    VkCommandPool pools[IMAGES];
    VkCommandBuffer commands[IMAGES];
    VkFence fences[IMAGES];
} Target;

// Requests a list of extensions, and stores its names. Every name must be there once.
static uint32_t extensions_of(const char *function, const char *names[16]) {
    if (!strcmp(text("extensions", ""), "none")) return 0;
    PFN_xrGetVulkanDeviceExtensionsKHR list;
    CHECK(xrGetInstanceProcAddr(xr, function, (PFN_xrVoidFunction *)&list));
    uint32_t needed = 0, again = 0, count = 0;
    CHECK(list(xr, system_id, 0, &needed, NULL));
    char *all = malloc(needed);
    memset(all, 'x', needed);
    if (list(xr, system_id, needed - 1, &again, all) != XR_ERROR_SIZE_INSUFFICIENT || again != needed || all[0] != 'x') exit(3);
    CHECK(list(xr, system_id, needed, &again, all));
    if (again != needed || strlen(all) + 1 != needed) exit(3);
    for (char *name = strtok(all, " "); name && count < 16; name = strtok(NULL, " ")) {
        for (uint32_t i = 0; i < count; i++)
            if (!strcmp(names[i], name)) exit(3);
        names[count++] = name;
    }
    return count;
}

static void make_device(void) {
    uint32_t version = !strcmp(text("vulkan", ""), "1.0") ? VK_API_VERSION_1_0 : VK_API_VERSION_1_1;
    int is_made = !strcmp(text("extensions", ""), "made");
    const char *names[16] = {"VK_KHR_get_physical_device_properties2"};
    VkApplicationInfo about = {VK_STRUCTURE_TYPE_APPLICATION_INFO, NULL, "client", 1, NULL, 0, version};
    VkInstanceCreateInfo info = {VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO, NULL, 0, &about, 0, NULL, 1, names};
    if (is_made) {
        PFN_xrCreateVulkanInstanceKHR make;
        CHECK(xrGetInstanceProcAddr(xr, "xrCreateVulkanInstanceKHR", (PFN_xrVoidFunction *)&make));
        XrVulkanInstanceCreateInfoKHR wanted = {XR_TYPE_VULKAN_INSTANCE_CREATE_INFO_KHR, NULL, system_id, 0, vkGetInstanceProcAddr, &info, NULL};
        VkResult answer;
        CHECK(make(xr, &wanted, &instance, &answer));
        CHECK(answer);
    } else {
        info.enabledExtensionCount = extensions_of("xrGetVulkanInstanceExtensionsKHR", names);
        CHECK(vkCreateInstance(&info, NULL, &instance));
    }
    PFN_xrGetVulkanGraphicsDeviceKHR find;
    CHECK(xrGetInstanceProcAddr(xr, "xrGetVulkanGraphicsDeviceKHR", (PFN_xrVoidFunction *)&find));
    CHECK(find(xr, system_id, instance, &physical));
    float priority = 1;
    VkDeviceQueueCreateInfo queues = {VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO, NULL, 0, 0, 1, &priority};
    VkDeviceCreateInfo made = {VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO, NULL, 0, 1, &queues, 0, NULL, 0, names, NULL};
    if (is_made) {
        PFN_xrCreateVulkanDeviceKHR make;
        CHECK(xrGetInstanceProcAddr(xr, "xrCreateVulkanDeviceKHR", (PFN_xrVoidFunction *)&make));
        names[0] = "VK_KHR_maintenance1", made.enabledExtensionCount = 1;
        XrVulkanDeviceCreateInfoKHR wanted = {XR_TYPE_VULKAN_DEVICE_CREATE_INFO_KHR, NULL, system_id, 0, vkGetInstanceProcAddr, physical, &made, NULL};
        VkResult answer;
        CHECK(make(xr, &wanted, &device, &answer));
        CHECK(answer);
    } else {
        made.enabledExtensionCount = extensions_of("xrGetVulkanDeviceExtensionsKHR", names);
        CHECK(vkCreateDevice(physical, &made, NULL, &device));
    }
    vkGetDeviceQueue(device, 0, 0, &queue);
}

static uint32_t visible_type(uint32_t fits) {
    VkPhysicalDeviceMemoryProperties all;
    vkGetPhysicalDeviceMemoryProperties(physical, &all);
    VkMemoryPropertyFlags wanted = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    uint32_t i = 0;
    while (!(fits >> i & 1) || (all.memoryTypes[i].propertyFlags & wanted) != wanted) i++;
    return i;
}

static void make_target(Target *target, int64_t format, uint32_t texel, int is_depth, uint32_t width, uint32_t height,
                        uint32_t layers, uint32_t samples) {
    *target = (Target){.width = width, .height = height, .layers = layers, .texel = texel, .format = format};
    target->aspect = is_depth ? VK_IMAGE_ASPECT_DEPTH_BIT : VK_IMAGE_ASPECT_COLOR_BIT;
    XrSwapchainUsageFlags usage = XR_SWAPCHAIN_USAGE_TRANSFER_DST_BIT |
        (is_depth ? XR_SWAPCHAIN_USAGE_DEPTH_STENCIL_ATTACHMENT_BIT : XR_SWAPCHAIN_USAGE_COLOR_ATTACHMENT_BIT);
    XrSwapchainCreateInfo info = {XR_TYPE_SWAPCHAIN_CREATE_INFO, NULL, 0, usage, format, samples, width, height, 1, layers, 1};
    pthread_mutex_lock(&queue_lock);
    CHECK(xrCreateSwapchain(session, &info, &target->chain));
    pthread_mutex_unlock(&queue_lock);
    XrSwapchainImageVulkanKHR images[IMAGES] = {{XR_TYPE_SWAPCHAIN_IMAGE_VULKAN_KHR, NULL, 0},
        {XR_TYPE_SWAPCHAIN_IMAGE_VULKAN_KHR, NULL, 0}, {XR_TYPE_SWAPCHAIN_IMAGE_VULKAN_KHR, NULL, 0}};
    uint32_t count;
    CHECK(xrEnumerateSwapchainImages(target->chain, IMAGES, &count, (XrSwapchainImageBaseHeader *)images));
    for (uint32_t i = 0; i < count; i++) {
        target->images[i] = images[i].image;
        VkBufferCreateInfo buffer = {VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO, NULL, 0, (VkDeviceSize)width * height * layers * texel,
                                     VK_BUFFER_USAGE_TRANSFER_SRC_BIT, 0, 0, NULL};
        CHECK(vkCreateBuffer(device, &buffer, NULL, &target->buffers[i]));
        VkMemoryRequirements needs;
        vkGetBufferMemoryRequirements(device, target->buffers[i], &needs);
        VkMemoryAllocateInfo memory = {VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, NULL, needs.size, visible_type(needs.memoryTypeBits)};
        CHECK(vkAllocateMemory(device, &memory, NULL, &target->memory[i]));
        CHECK(vkBindBufferMemory(device, target->buffers[i], target->memory[i], 0));
        CHECK(vkMapMemory(device, target->memory[i], 0, VK_WHOLE_SIZE, 0, (void **)&target->mapped[i]));
        VkCommandPoolCreateInfo pool = {VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO, NULL, 0, 0};
        CHECK(vkCreateCommandPool(device, &pool, NULL, &target->pools[i]));
        VkCommandBufferAllocateInfo commands = {VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO, NULL, target->pools[i], 0, 1};
        CHECK(vkAllocateCommandBuffers(device, &commands, &target->commands[i]));
        VkFenceCreateInfo fence = {VK_STRUCTURE_TYPE_FENCE_CREATE_INFO, NULL, VK_FENCE_CREATE_SIGNALED_BIT};
        CHECK(vkCreateFence(device, &fence, NULL, &target->fences[i]));
    }
}

static void end_target(Target *target) {
    if (!target->chain) return;
    for (int i = 0; i < IMAGES && target->images[i]; i++) {
        vkWaitForFences(device, 1, &target->fences[i], 1, PATIENCE_NS);
        vkDestroyFence(device, target->fences[i], NULL);
        vkDestroyCommandPool(device, target->pools[i], NULL);
        vkDestroyBuffer(device, target->buffers[i], NULL);
        vkFreeMemory(device, target->memory[i], NULL);
    }
    CHECK(xrDestroySwapchain(target->chain));
    target->chain = XR_NULL_HANDLE;
}

static uint16_t half(float value) {
    // Values are 0 to 255 / 255, which is enough for normal numbers and 0.
    if (value <= 0) return 0;
    int exponent;
    float fraction = frexpf(value, &exponent);
    return (uint16_t)((exponent + 14) << 10 | (int)lrintf((fraction * 2 - 1) * 1024));
}

// The levels of a pixel of an eye. The first pixel has the number of the frame.
static void levels(uint32_t frame, uint32_t eye, uint32_t x, uint32_t y, uint8_t out[3]) {
    out[0] = x || y ? (uint8_t)(x * 5 + frame) : (uint8_t)frame;
    out[1] = x || y ? (uint8_t)(y * 7 + 2 * frame + 64 * eye) : (uint8_t)(frame >> 8);
    out[2] = x || y ? (uint8_t)(x * 3 + y * 11 + 3 * frame) : (uint8_t)(100 + eye);
}

static void write_texel(const Target *target, uint8_t *to, uint32_t frame, uint32_t eye, uint32_t x, uint32_t y) {
    if (target->aspect == VK_IMAGE_ASPECT_DEPTH_BIT) {
        uint32_t depth = (x * 997 + y * 131 + frame * 17 + eye * 7001) & 0xffff;
        float real_depth = (float)depth / 65535;
        uint32_t deep = depth << 8 | depth >> 8;
        if (target->format == VK_FORMAT_D16_UNORM) memcpy(to, &depth, 2);
        else if (target->format == VK_FORMAT_D32_SFLOAT) memcpy(to, &real_depth, 4);
        else memcpy(to, &deep, 4);
        return;
    }
    uint8_t l[3];
    levels(frame, eye, x, y, l);
    if (target->format == VK_FORMAT_R16G16B16A16_SFLOAT) {
        uint16_t texel[4] = {half(l[0] / 255.0f), half(l[1] / 255.0f), half(l[2] / 255.0f), 0x3c00};
        memcpy(to, texel, 8);
    } else if (target->format == VK_FORMAT_A2B10G10R10_UNORM_PACK32) {
        uint32_t texel = 3u << 30 | l[2] * 1023u / 255 << 20 | l[1] * 1023u / 255 << 10 | l[0] * 1023u / 255;
        memcpy(to, &texel, 4);
    } else {
        int swap = target->format == VK_FORMAT_B8G8R8A8_SRGB;
        uint8_t texel[4] = {l[swap ? 2 : 0], l[1], l[swap ? 0 : 2], 255};
        memcpy(to, texel, 4);
    }
}

static VkImageMemoryBarrier change(const Target *target, uint32_t i, VkImageLayout from, VkImageLayout to) {
    VkImageAspectFlags stencil = target->format == VK_FORMAT_D24_UNORM_S8_UINT ? VK_IMAGE_ASPECT_STENCIL_BIT : 0;
    return (VkImageMemoryBarrier){VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER, NULL, VK_ACCESS_MEMORY_WRITE_BIT,
        VK_ACCESS_MEMORY_WRITE_BIT | VK_ACCESS_MEMORY_READ_BIT, from, to, VK_QUEUE_FAMILY_IGNORED, VK_QUEUE_FAMILY_IGNORED,
        target->images[i], {target->aspect | stencil, 0, 1, 0, VK_REMAINING_ARRAY_LAYERS}};
}

// Renders a frame and releases the image, without a wait for the device.
static void render(Target *target, uint32_t frame, uint32_t eye_width) {
    uint32_t i;
    CHECK(xrAcquireSwapchainImage(target->chain, NULL, &i));
    XrSwapchainImageWaitInfo patience = {XR_TYPE_SWAPCHAIN_IMAGE_WAIT_INFO, NULL, XR_INFINITE_DURATION};
    CHECK(xrWaitSwapchainImage(target->chain, &patience));
    CHECK(vkWaitForFences(device, 1, &target->fences[i], 1, PATIENCE_NS));
    CHECK(vkResetFences(device, 1, &target->fences[i]));
    uint8_t *to = target->mapped[i];
    for (uint32_t layer = 0; layer < target->layers; layer++)
        for (uint32_t y = 0; y < target->height; y++)
            for (uint32_t x = 0; x < target->width; x++, to += target->texel)
                write_texel(target, to, frame, layer + x / eye_width, x % eye_width, y);
    VkImageLayout usual = target->aspect == VK_IMAGE_ASPECT_DEPTH_BIT ? VK_IMAGE_LAYOUT_DEPTH_STENCIL_ATTACHMENT_OPTIMAL
                                                                      : VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL;
    CHECK(vkResetCommandPool(device, target->pools[i], 0));
    VkCommandBufferBeginInfo begin = {VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO, NULL, 0, NULL};
    CHECK(vkBeginCommandBuffer(target->commands[i], &begin));
    VkImageMemoryBarrier before = change(target, i, usual, VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL);
    VkImageMemoryBarrier back = change(target, i, VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, usual);
    VkPipelineStageFlags all = VK_PIPELINE_STAGE_ALL_COMMANDS_BIT;
    vkCmdPipelineBarrier(target->commands[i], all, all, 0, 0, NULL, 0, NULL, 1, &before);
    VkBufferImageCopy region = {0, 0, 0, {target->aspect, 0, 0, target->layers}, {0, 0, 0}, {target->width, target->height, 1}};
    vkCmdCopyBufferToImage(target->commands[i], target->buffers[i], target->images[i], VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, 1, &region);
    vkCmdPipelineBarrier(target->commands[i], all, all, 0, 0, NULL, 0, NULL, 1, &back);
    CHECK(vkEndCommandBuffer(target->commands[i]));
    VkSubmitInfo submit = {VK_STRUCTURE_TYPE_SUBMIT_INFO, NULL, 0, NULL, NULL, 1, &target->commands[i], 0, NULL};
    pthread_mutex_lock(&queue_lock);
    CHECK(vkQueueSubmit(queue, 1, &submit, target->fences[i]));
    CHECK(xrReleaseSwapchainImage(target->chain, NULL));
    pthread_mutex_unlock(&queue_lock);
}

static void *noise(void *nothing) {
    while (runs) {
        pthread_mutex_lock(&queue_lock);
        CHECK(vkQueueSubmit(queue, 0, NULL, VK_NULL_HANDLE));
        pthread_mutex_unlock(&queue_lock);
    }
    return nothing;
}

static void wait_state(XrSessionState wanted) {
    for (;;) {
        XrEventDataBuffer event = {XR_TYPE_EVENT_DATA_BUFFER};
        XrResult result = xrPollEvent(xr, &event);
        CHECK(result);
        if (result == XR_EVENT_UNAVAILABLE) continue;
        if (((XrEventDataSessionStateChanged *)&event)->state == wanted) return;
    }
}

// The sub-image of an eye.
static XrSwapchainSubImage part(const Target *target, uint32_t eye, uint32_t width) {
    int wide = target->layers == 1 && target->width > width;
    return (XrSwapchainSubImage){target->chain, {{wide ? (int)(eye * width) : 0, 0}, {(int)width, (int)target->height}}, wide ? 0 : eye};
}

static const XrPosef in_front = {{0, 0, 0, 1}, {0, 0, -2}};

static void end_frame(XrTime time, uint32_t frame, Target *color, Target *depth, Target *panel, uint32_t width) {
    XrViewLocateInfo where = {XR_TYPE_VIEW_LOCATE_INFO, NULL, XR_VIEW_CONFIGURATION_TYPE_PRIMARY_STEREO, time, local};
    XrViewState found = {XR_TYPE_VIEW_STATE, NULL, 0};
    XrView views[2] = {{XR_TYPE_VIEW}, {XR_TYPE_VIEW}};
    uint32_t count;
    CHECK(xrLocateViews(session, &where, &found, 2, &count, views));
    float tangent = real("tangent", "0"), angle = atanf(tangent);
    XrCompositionLayerDepthInfoKHR depths[2];
    XrCompositionLayerProjectionView seen[2];
    for (uint32_t eye = 0; eye < 2; eye++) {
        float up = atanf(tangent * (float)color->height / (float)width);
        if (tangent > 0) views[eye].fov = (XrFovf){-angle, angle, up, -up};
        if (depth->chain)
            depths[eye] = (XrCompositionLayerDepthInfoKHR){XR_TYPE_COMPOSITION_LAYER_DEPTH_INFO_KHR, NULL, part(depth, eye, width),
                                                           0, 1, real("near", "0.1"), real("far", "inf")};
        seen[eye] = (XrCompositionLayerProjectionView){XR_TYPE_COMPOSITION_LAYER_PROJECTION_VIEW, depth->chain ? &depths[eye] : NULL,
                                                       views[eye].pose, views[eye].fov, part(color, eye, width)};
    }
    XrCompositionLayerProjection projection = {XR_TYPE_COMPOSITION_LAYER_PROJECTION, NULL, 0, local, 2, seen};
    XrSwapchainSubImage image = part(panel, 0, panel->width);
    // The panel of the local space is 2 m in front of the head of the null runtime's left eye.
    XrPosef eye = views[0].pose, at = eye;
    float s = 2 * (eye.orientation.y * eye.orientation.w), c = 1 - 2 * eye.orientation.y * eye.orientation.y;
    at.position.x -= 2 * s, at.position.z -= 2 * c;
    XrCompositionLayerQuad quad = {XR_TYPE_COMPOSITION_LAYER_QUAD, NULL, XR_COMPOSITION_LAYER_BLEND_TEXTURE_SOURCE_ALPHA_BIT,
                                   local, XR_EYE_VISIBILITY_BOTH, image, at, {0.8f, 0.8f}};
    XrCompositionLayerQuad fixed = quad;
    fixed.space = view_space, fixed.pose = in_front, fixed.pose.position.x = -0.03f;
    XrCompositionLayerCylinderKHR cylinder = {XR_TYPE_COMPOSITION_LAYER_CYLINDER_KHR, NULL, 0, view_space, XR_EYE_VISIBILITY_BOTH,
                                              image, {{0, 0, 0, 1}, {-0.03f, 0, 0}}, 2, 0.4f, 1};
    const XrCompositionLayerBaseHeader *layers[4];
    uint32_t used = 0;
    if (shows("projection")) layers[used++] = (void *)&projection;
    if (shows("view-quad")) layers[used++] = (void *)&fixed;
    else if (shows("quad")) layers[used++] = (void *)&quad;
    if (shows("cylinder")) layers[used++] = (void *)&cylinder;
    uint32_t from = 0, until = 0;
    if (sscanf(text("pause", ""), "%u-%u", &from, &until) == 2 && frame >= from && frame < until) used = 0;
    XrFrameEndInfo info = {XR_TYPE_FRAME_END_INFO, NULL, time, XR_ENVIRONMENT_BLEND_MODE_OPAQUE, used, layers};
    pthread_mutex_lock(&queue_lock);
    CHECK(xrEndFrame(session, &info));
    pthread_mutex_unlock(&queue_lock);
}

static long memory_kib(void) {
    char line[128];
    long kib = 0;
    FILE *file = fopen("/proc/self/status", "r");
    while (file && fgets(line, sizeof line, file)) sscanf(line, "VmRSS: %ld", &kib);
    if (file) fclose(file);
    return kib;
}

static double now_us(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1e6 + now.tv_nsec * 1e-3;
}

static void make_targets(Target *color, Target *depth, uint32_t width, uint32_t height) {
    int wide = !strcmp(text("layout", "array"), "wide");
    const char *name = text("color", "srgb");
    int64_t format = !strcmp(name, "unorm") ? VK_FORMAT_R8G8B8A8_UNORM
        : !strcmp(name, "bgra") ? VK_FORMAT_B8G8R8A8_SRGB
        : !strcmp(name, "half") ? VK_FORMAT_R16G16B16A16_SFLOAT
        : !strcmp(name, "ten") ? VK_FORMAT_A2B10G10R10_UNORM_PACK32 : VK_FORMAT_R8G8B8A8_SRGB;
    uint32_t texel = format == VK_FORMAT_R16G16B16A16_SFLOAT ? 8 : 4, layers = wide ? 1 : 2;
    make_target(color, format, texel, 0, wide ? 2 * width : width, height, layers, number("samples", 1));
    name = text("depth", "none");
    if (!strcmp(name, "none")) return;
    format = !strcmp(name, "d16") ? VK_FORMAT_D16_UNORM : !strcmp(name, "d24") ? VK_FORMAT_D24_UNORM_S8_UINT : VK_FORMAT_D32_SFLOAT;
    make_target(depth, format, format == VK_FORMAT_D16_UNORM ? 2 : 4, 1, wide ? 2 * width : width, height, layers, 1);
}

static void run_session(void) {
    int gl = !strcmp(text("graphics", "vulkan"), "gl");
    XrGraphicsBindingVulkanKHR vulkan = {XR_TYPE_GRAPHICS_BINDING_VULKAN_KHR, NULL, instance, physical, device, 0, 0};
    struct { XrStructureType type; const void *next; void *rest[8]; } open_gl = {XR_TYPE_GRAPHICS_BINDING_OPENGL_XLIB_KHR, NULL, {0}};
    XrSessionCreateInfo info = {XR_TYPE_SESSION_CREATE_INFO, gl ? (void *)&open_gl : (void *)&vulkan, 0, system_id};
    CHECK(xrCreateSession(xr, &info, &session));
    if (gl) {
        CHECK(xrDestroySession(session));
        return;
    }
    wait_state(XR_SESSION_STATE_READY);
    XrSessionBeginInfo begin = {XR_TYPE_SESSION_BEGIN_INFO, NULL, XR_VIEW_CONFIGURATION_TYPE_PRIMARY_STEREO};
    CHECK(xrBeginSession(session, &begin));
    XrReferenceSpaceCreateInfo space = {XR_TYPE_REFERENCE_SPACE_CREATE_INFO, NULL, XR_REFERENCE_SPACE_TYPE_LOCAL, {{0, 0, 0, 1}, {0, 0, 0}}};
    CHECK(xrCreateReferenceSpace(session, &space, &local));
    space.referenceSpaceType = XR_REFERENCE_SPACE_TYPE_VIEW;
    CHECK(xrCreateReferenceSpace(session, &space, &view_space));
    uint32_t width = 96, height = 64, frames = number("frames", 100);
    sscanf(text("size", ""), "%ux%u", &width, &height);
    Target color, depth = {0}, panel;
    make_targets(&color, &depth, width, height);
    make_target(&panel, VK_FORMAT_R8G8B8A8_UNORM, 4, 0, 16, 16, 1, 1);
    pthread_t thread;
    runs = number("noise", 0);
    if (runs) pthread_create(&thread, NULL, noise, NULL);
    // Later sessions do not wait.
    static int read;
    while (!strcmp(text("start", ""), "line") && read != '\n' && read != EOF) read = getchar();
    long early = 0;
    double begun = 0;
    for (uint32_t frame = 1; frame <= frames; frame++) {
        if (frame == frames / 4) early = memory_kib();
        // The first frames make buffers.
        if (frame == frames / 10 + 1) begun = now_us();
        if ((int)frame == number("die", 0)) raise(SIGKILL);
        if ((int)frame == number("resize", 0)) {
            end_target(&color), end_target(&depth);
            make_targets(&color, &depth, width /= 2, height /= 2);
        }
        XrFrameState state = {XR_TYPE_FRAME_STATE};
        CHECK(xrWaitFrame(session, NULL, &state));
        pthread_mutex_lock(&queue_lock);
        CHECK(xrBeginFrame(session, NULL));
        pthread_mutex_unlock(&queue_lock);
        if (number("samples", 1) == 1) {
            render(&color, frame, width);
        } else {
            uint32_t image;
            CHECK(xrAcquireSwapchainImage(color.chain, NULL, &image));
            CHECK(xrReleaseSwapchainImage(color.chain, NULL));
        }
        if (depth.chain) render(&depth, frame, width);
        if (frame == 1 || strcmp(text("panel", ""), "once")) render(&panel, frame, 16);
        end_frame(state.predictedDisplayTime, frame, &color, &depth, &panel, width);
    }
    double each = (now_us() - begun) / (frames - frames / 10);
    runs = 0;
    if (number("noise", 0)) pthread_join(thread, NULL);
    printf("client: %u frames, %ld KiB then %ld KiB, %.1f us per frame\n", frames, early, memory_kib(), each);
    fflush(stdout);
    CHECK(xrRequestExitSession(session));
    wait_state(XR_SESSION_STATE_STOPPING);
    CHECK(xrEndSession(session));
    end_target(&color), end_target(&depth), end_target(&panel);
    CHECK(xrDestroySpace(local));
    CHECK(xrDestroySpace(view_space));
    CHECK(xrDestroySession(session));
}

int main(int count, char **arguments) {
    words = count, word = arguments;
    const char *extensions[] = {"XR_KHR_vulkan_enable", "XR_KHR_vulkan_enable2", "XR_KHR_composition_layer_cylinder",
                                "XR_KHR_opengl_enable", "XR_KHR_composition_layer_depth"};
    uint32_t used = strcmp(text("depth", "none"), "none") ? 5 : 4;
    XrInstanceCreateInfo info = {XR_TYPE_INSTANCE_CREATE_INFO, NULL, 0, {"client", 1, "", 0, XR_CURRENT_API_VERSION}, 0, NULL, used, extensions};
    CHECK(xrCreateInstance(&info, &xr));
    XrSystemGetInfo wanted = {XR_TYPE_SYSTEM_GET_INFO, NULL, XR_FORM_FACTOR_HEAD_MOUNTED_DISPLAY};
    CHECK(xrGetSystem(xr, &wanted, &system_id));
    PFN_xrGetVulkanGraphicsRequirementsKHR requirements;
    CHECK(xrGetInstanceProcAddr(xr, "xrGetVulkanGraphicsRequirementsKHR", (PFN_xrVoidFunction *)&requirements));
    XrGraphicsRequirementsVulkanKHR needs = {XR_TYPE_GRAPHICS_REQUIREMENTS_VULKAN_KHR, NULL, 0, 0};
    CHECK(requirements(xr, system_id, &needs));
    make_device();
    for (int i = 0; i < number("sessions", 1); i++) run_session();
    vkDeviceWaitIdle(device);
    vkDestroyDevice(device, NULL);
    vkDestroyInstance(instance, NULL);
    CHECK(xrDestroyInstance(xr));
    return 0;
}
