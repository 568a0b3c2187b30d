//! Many threads open, use and close devices under the validation layer at once, as the tests of one process do.

use crate::one_device::{INSIDE, again};
use eyebox::low_level::engine::{Engine, Kernel, Purpose};
use eyebox::low_level::gpu::{Gpu, Options};
use eyebox_kernels::compare::INTENSITY;
use eyebox_tests::both::{Case, assert_silent, vulkan, watched};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

/// One thread at a time has the options for a device with the validation layer, until the thread ends.
#[test]
fn one_thread_at_a_time_uses_the_validation_layer() {
    let holders = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..8 {
            scope.spawn(|| {
                let _options = watched();
                assert_eq!(holders.fetch_add(1, Ordering::SeqCst), 0);
                std::thread::sleep(Duration::from_millis(2));
                holders.fetch_sub(1, Ordering::SeqCst);
            });
        }
    });
}

/// Without turns (`runtime/compute/gpu/vulkan/test_options.rs`) one run in ten crashes inside the layer with
/// `EYEBOX_INSTANCES=6`.
#[test]
fn watched_devices_come_and_go_on_many_threads() {
    let rounds = std::env::var("EYEBOX_INSTANCES").map_or(1, |text| text.parse().expect("a number"));
    let case = Case::new(7, 13, 0, 15e-3, 1);
    let step = case.single(Purpose::Project, INTENSITY, 1.0, Kernel::Modulate);
    std::thread::scope(|scope| {
        for _ in 0..16 {
            scope.spawn(|| {
                for _ in 0..rounds {
                    let mut engine = vulkan();
                    for _ in 0..20 {
                        case.load(&mut engine, Purpose::Project);
                        engine.run(&step).expect("the kernel runs");
                    }
                    assert_silent(engine);
                }
            });
        }
    });
}

/// An unloaded driver may not load again (NVIDIA's does not after four rounds). It therefore stays loaded from the
/// second device on.
#[test]
#[cfg(target_os = "linux")]
fn drivers_stay_loaded() {
    if std::env::var_os(INSIDE).is_none() {
        return drop(again("instances::drivers_stay_loaded", &[]));
    }
    let open = || Gpu::open(&Options { allow_cpu: true, ..Options::default() }).expect("a device");
    let loaded = || -> std::collections::BTreeSet<String> {
        let maps = std::fs::read_to_string("/proc/self/maps").expect("maps");
        maps.lines().filter_map(|line| Some(line.split_once('/')?.1.to_owned())).filter(|f| f.contains(".so")).collect()
    };
    let before = loaded();
    drop(open());
    let gpu = open();
    let with = loaded();
    drop(gpu);
    assert!(with.len() > before.len());
    assert_eq!(loaded(), with);
}
