// Refines a hologram for a moving pupil, in C++. Build and run it with this command.
//     c++ -std=c++17 refine.cpp $(pkg-config --cflags --libs eyebox) -o refine && ./refine 256 60
#include "eyebox.h"
#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string>

namespace eyebox {

// These types free their handles, and check() turns failures into exceptions.
template <auto release> struct Release {
    template <class T> void operator()(T *handle) const { release(handle); }
};
using Display = std::unique_ptr<EyeboxDisplay, Release<eyebox_display_free>>;
using Engine = std::unique_ptr<EyeboxEngine, Release<eyebox_engine_free>>;
using Scene = std::unique_ptr<EyeboxScene, Release<eyebox_scene_free>>;
using Hologram = std::unique_ptr<EyeboxHologram, Release<eyebox_hologram_free>>;
using Refiner = std::unique_ptr<EyeboxRefiner, Release<eyebox_refiner_free>>;

inline void check(EyeboxStatus status) {
    if (status != EYEBOX_STATUS_OK) throw std::runtime_error(eyebox_last_error());
}

// Calls a function whose last argument receives a handle, and returns the handle, as in this example.
//     make<Scene>(eyebox_scene_load, "builtin:plane", display.get(), 0u, std::size_t{0})
template <class Handle, class Make, class... Given> Handle make(Make function, Given... given) {
    typename Handle::pointer made = nullptr;
    check(function(given..., &made));
    return Handle(made);
}

} // namespace eyebox

int main(int argc, char **argv) try {
    using namespace eyebox;
    const std::size_t size = argc > 1 ? std::stoul(argv[1]) : 256;
    const std::string settings = std::string("frames = 4\nsteps = ") + (argc > 2 ? argv[2] : "60");
    const auto preset = make<Display>(eyebox_display_load, "paper");
    const auto display = make<Display>(eyebox_display_resized, preset.get(), size, size);
    const auto engine = make<Engine>(eyebox_engine_open, "cpu");
    const auto scene = make<Scene>(eyebox_scene_load, "builtin:still-life", display.get(), EYEBOX_GREEN, std::size_t{0});
    const auto whole = make<Hologram>(eyebox_solve, scene.get(), display.get(), settings.c_str(), engine.get(), nullptr, nullptr);
    const auto refiner = make<Refiner>(eyebox_refiner_new, whole.get(), scene.get(), nullptr, engine.get());
    for (const double x : {-4e-3, 0.0, 4e-3}) {
        const EyeboxPupil pupil = {x, 0.0, 4e-3, 0.0};
        double loss = 0.0;
        check(eyebox_refiner_aim(refiner.get(), &pupil, 0.25e-3));
        check(eyebox_refiner_step(refiner.get(), 4, &loss));
        const auto refined = make<Hologram>(eyebox_refiner_hologram, refiner.get());
        EyeboxScore before, after;
        check(eyebox_score(whole.get(), scene.get(), &pupil, 1, nullptr, engine.get(), &before));
        check(eyebox_score(refined.get(), scene.get(), &pupil, 1, nullptr, engine.get(), &after));
        std::printf("pupil at %4.1f mm: %.1f dB, refined %.1f dB\n", x * 1e3, before.psnr_db, after.psnr_db);
    }
    return 0;
} catch (const std::exception &error) {
    std::fprintf(stderr, "refine: %s\n", error.what());
    return 2;
}
