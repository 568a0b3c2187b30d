// Solves on a Vulkan device that the program opened and keeps. Build and run it with these commands.
//     c++ -std=c++17 vulkan_device.cpp $(pkg-config --cflags --libs eyebox vulkan) -o vulkan_device
//     ./vulkan_device 64 10
#include "eyebox.h"
#include <cstdio>
#include <stdexcept>
#include <string>
#include <vector>
#include <vulkan/vulkan.h>

namespace {

void check(EyeboxStatus status) {
    if (status != EYEBOX_STATUS_OK) throw std::runtime_error(eyebox_last_error());
}

void check(VkResult result, const char *what) {
    if (result != VK_SUCCESS) throw std::runtime_error(std::string(what) + ": " + std::to_string(result));
}

// The program's own device. It is the first device, with a compute queue and the one feature that eyebox requires.
struct Own {
    VkInstance instance = VK_NULL_HANDLE;
    VkPhysicalDevice physical = VK_NULL_HANDLE;
    VkDevice device = VK_NULL_HANDLE;
    VkQueue queue = VK_NULL_HANDLE;
    uint32_t family = 0;

    Own() {
        VkApplicationInfo about = {};
        about.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO;
        about.apiVersion = VK_API_VERSION_1_2;
        VkInstanceCreateInfo instance_info = {};
        instance_info.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO;
        instance_info.pApplicationInfo = &about;
        check(vkCreateInstance(&instance_info, nullptr, &instance), "vkCreateInstance");
        uint32_t count = 1;
        const VkResult found = vkEnumeratePhysicalDevices(instance, &count, &physical);
        if (count == 0) throw std::runtime_error("there is no device");
        if (found != VK_INCOMPLETE) check(found, "vkEnumeratePhysicalDevices");
        vkGetPhysicalDeviceQueueFamilyProperties(physical, &count, nullptr);
        std::vector<VkQueueFamilyProperties> families(count);
        vkGetPhysicalDeviceQueueFamilyProperties(physical, &count, families.data());
        while (family < count && !(families[family].queueFlags & VK_QUEUE_COMPUTE_BIT)) ++family;
        if (family == count) throw std::runtime_error("it does not compute");
        const float priority = 1.0f;
        VkDeviceQueueCreateInfo queue_info = {};
        queue_info.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO;
        queue_info.queueFamilyIndex = family;
        queue_info.queueCount = 1;
        queue_info.pQueuePriorities = &priority;
        VkPhysicalDeviceVulkan12Features features = {};
        features.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES;
        features.timelineSemaphore = VK_TRUE;
        VkDeviceCreateInfo device_info = {};
        device_info.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO;
        device_info.pNext = &features;
        device_info.queueCreateInfoCount = 1;
        device_info.pQueueCreateInfos = &queue_info;
        check(vkCreateDevice(physical, &device_info, nullptr, &device), "vkCreateDevice");
        vkGetDeviceQueue(device, family, 0, &queue);
    }
    ~Own() {
        if (device) vkDestroyDevice(device, nullptr);
        if (instance) vkDestroyInstance(instance, nullptr);
    }
    Own(const Own &) = delete;
    Own &operator=(const Own &) = delete;
};

} // namespace

int main(int argc, char **argv) try {
    const std::size_t size = argc > 1 ? std::stoul(argv[1]) : 64;
    const std::string settings = std::string("frames = 2\nseed = 1\nsteps = ") + (argc > 2 ? argv[2] : "10");
    Own own; // The device must exist longer than the engine, so it is made first.
    EyeboxEngine *engine = nullptr;
    EyeboxDisplay *preset = nullptr, *display = nullptr;
    EyeboxScene *scene = nullptr;
    EyeboxHologram *hologram = nullptr;
    check(eyebox_engine_vulkan_device(own.instance, own.physical, own.device, own.family, own.queue, &engine));
    const char *reason = nullptr;
    check(eyebox_engine_reason(engine, &reason));
    std::printf("%s\n", reason);
    // The program's own work on the queue.
    const auto own_work = [](void *of) { vkQueueWaitIdle(static_cast<Own *>(of)->queue); };
    check(eyebox_engine_with_queue(engine, own_work, &own));
    check(eyebox_display_load("small", &preset));
    check(eyebox_display_resized(preset, size, size, &display));
    check(eyebox_scene_load("builtin:still-life", display, EYEBOX_GREEN, 3, &scene));
    check(eyebox_solve(scene, display, settings.c_str(), engine, nullptr, nullptr, &hologram));
    const EyeboxPupil middle = {0.0, 0.0, 4e-3, 0.0};
    EyeboxScore score;
    check(eyebox_score(hologram, scene, &middle, 1, nullptr, engine, &score));
    std::printf("%.1f dB in the middle\n", score.psnr_db);
    eyebox_hologram_free(hologram);
    eyebox_scene_free(scene);
    eyebox_display_free(display);
    eyebox_display_free(preset);
    eyebox_engine_free(engine);
    return 0;
} catch (const std::exception &error) {
    std::fprintf(stderr, "vulkan_device: %s\n", error.what());
    return 2;
}
