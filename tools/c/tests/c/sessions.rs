//! Tests sessions that their caller ticks, and engines on the caller's own device.

use crate::common::{Refusal, handle, made, refused};
use eyebox::low_level::gpu::ash::{self, vk, vk::Handle};
use eyebox_c::*;
use std::ffi::{CStr, c_void};
use std::mem::MaybeUninit;
use std::ptr::{null, null_mut};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

struct Whole {
    display: Box<EyeboxDisplay>,
    engine: Box<EyeboxEngine>,
    scene: Box<EyeboxScene>,
    hologram: Box<EyeboxHologram>,
}

fn whole() -> Whole {
    // SAFETY: Every text ends with a zero byte.
    unsafe {
        let preset = handle(|out| eyebox_display_load(c"planes8".as_ptr(), Some(out))).unwrap();
        let display = handle(|out| eyebox_display_resized(Some(&preset), 32, 32, Some(out))).unwrap();
        let engine = handle(|out| eyebox_engine_open(c"cpu".as_ptr(), Some(out))).unwrap();
        let source = c"builtin:still-life".as_ptr();
        let scene = handle(|out| eyebox_scene_load(source, Some(&display), EYEBOX_GREEN, 3, Some(out))).unwrap();
        let hologram = solve(&scene, &display, &engine, c"steps = 2\nframes = 8\npupils = 2\nseed = 7");
        Whole { display, engine, scene, hologram }
    }
}

fn solve(scene: &EyeboxScene, display: &EyeboxDisplay, engine: &EyeboxEngine, settings: &CStr) -> Box<EyeboxHologram> {
    let (scene, display, engine) = (Some(scene), Some(display), Some(engine));
    // SAFETY: The text ends with a zero byte.
    let solved =
        handle(|out| unsafe { eyebox_solve(scene, display, settings.as_ptr(), engine, None, null_mut(), Some(out)) });
    solved.unwrap()
}

fn phases(hologram: &EyeboxHologram) -> Vec<u32> {
    let mut count = MaybeUninit::uninit();
    let at = made(|at| eyebox_hologram_phases(Some(hologram), 0, Some(at), Some(&mut count))).unwrap();
    // SAFETY: The hologram has this number of phases in its memory.
    unsafe { std::slice::from_raw_parts(at, count.assume_init()) }.iter().map(|phase| phase.to_bits()).collect()
}

fn tick(session: &EyeboxSession, picture: &mut [u8]) -> Result<EyeboxFrame, Refusal> {
    let (at, bytes) = (picture.as_mut_ptr().cast::<c_void>(), picture.len());
    // SAFETY: The memory has the stated size.
    made(|out| unsafe { eyebox_session_tick(Some(session), 0.01, at, bytes, Some(out)) })
}

#[test]
fn what_is_played_is_what_is_encoded() {
    let Whole { display, hologram, .. } = whole();
    let encoder = handle(|out| eyebox_encoder_new(Some(&display), EYEBOX_GREEN, 8, Some(out))).unwrap();
    let mut encoded = vec![0u8; 32 * 32];
    let at = encoded.as_mut_ptr().cast::<c_void>();
    // SAFETY: The memory has the stated size.
    let status = unsafe { eyebox_encode(Some(&encoder), Some(&hologram), at, encoded.len()) };
    assert_eq!(status, EyeboxStatus::Ok);
    let session = handle(|out| eyebox_session_play(Some(&hologram), Some(&display), 60.0, Some(out))).unwrap();
    drop(hologram);
    let video = made(|out| eyebox_session_video(Some(&session), Some(out))).unwrap();
    assert_eq!((video.frames, video.rows, video.columns, video.channels, video.bytes), (1, 32, 32, 1, 1024));
    let (mut picture, begun) = (vec![0u8; 1024], Instant::now());
    let frame = loop {
        let frame = tick(&session, &mut picture).unwrap();
        assert!(begun.elapsed() < Duration::from_secs(60) && frame.shown == 1);
        if frame.set >= 0 {
            break frame;
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    assert!(frame.set == 0 && frame.begins == 1 && frame.part == 0 && picture == encoded);
    // Wrong calls are refused, and the session continues.
    let sample = EyeboxSample { x_m: 0.0, y_m: 0.0, diameter_m: 0.0, age_s: 0.0 };
    assert_eq!(eyebox_session_look(Some(&session), Some(&sample)), EyeboxStatus::Argument);
    Refusal::last(EyeboxStatus::Argument).is("argument session");
    refused(tick(&session, &mut picture[..100]), "argument 100 1024");
    refused(handle(|out| eyebox_session_play(None, Some(&display), 60.0, Some(out))), "null hologram");
    assert!(tick(&session, &mut picture).unwrap().number > frame.number);
    let account = made(|out| eyebox_session_account(Some(&session), Some(out))).unwrap();
    assert!(account.sets > account.idle_sets && account.steps == 0 && account.sample_age_ms.is_nan());
}

#[test]
fn an_eye_is_followed_while_another_thread_tells_of_it() {
    let Whole { display, engine, scene, hologram } = whole();
    let session = handle(|out| {
        let (hologram, scene, display) = (Some(&*hologram), Some(&*scene), Some(&*display));
        // SAFETY: The text is null.
        unsafe { eyebox_session_follow(hologram, scene, display, null(), Some(&engine), 60.0, Some(out)) }
    })
    .unwrap();
    drop((hologram, scene, display, engine));
    let over = AtomicBool::new(false);
    std::thread::scope(|threads| {
        threads.spawn(|| {
            while !over.load(Ordering::Relaxed) {
                let sample = EyeboxSample { x_m: 2e-3, y_m: -1e-3, diameter_m: 4e-3, age_s: 0.005 };
                assert_eq!(eyebox_session_look(Some(&session), Some(&sample)), EyeboxStatus::Ok);
                let moving = eyebox_session_look_moving(Some(&session), Some(&sample), 0.01, f64::NAN);
                assert_eq!(moving, EyeboxStatus::Ok);
                std::thread::sleep(Duration::from_millis(5));
            }
        });
        let (mut picture, mut pictures, begun) = (vec![0u8; 1024], Vec::new(), Instant::now());
        while pictures.len() < 3 && begun.elapsed() < Duration::from_secs(60) {
            let frame = tick(&session, &mut picture).unwrap();
            if frame.set >= 0 && !pictures.contains(&picture) {
                pictures.push(picture.clone());
            }
            std::thread::sleep(Duration::from_millis(16));
        }
        over.store(true, Ordering::Relaxed);
        assert_eq!(pictures.len(), 3);
    });
    assert_eq!(eyebox_session_steer(Some(&session), 0), EyeboxStatus::Ok);
    let sample = EyeboxSample { x_m: 0.0, y_m: 0.0, diameter_m: 0.0, age_s: 11.0 };
    assert_eq!(eyebox_session_look(Some(&session), Some(&sample)), EyeboxStatus::Argument);
    let account = made(|out| eyebox_session_account(Some(&session), Some(out))).unwrap();
    assert!(account.sets_new >= 3 && account.steps >= 3 && account.sample_age_ms > 5.0, "{account:?}");
    eyebox_session_free(Some(session));
}

extern "C" fn waits(user: *mut c_void) {
    // SAFETY: This is the pointer that `eyebox_engine_with_queue` received.
    unsafe { *user.cast::<u32>() += 1 };
}

#[test]
fn the_callers_own_device_computes_what_the_librarys_does() {
    let Whole { display, engine: cpu, scene, .. } = whole();
    let settings = c"steps = 2\nframes = 2\npupils = 2\nseed = 7";
    // SAFETY: The text ends with a zero byte.
    let Ok(vulkan) = handle(|out| unsafe { eyebox_engine_open(c"vulkan".as_ptr(), Some(out)) }) else {
        return println!("no Vulkan device is available, so there is nothing to compare");
    };
    let theirs = phases(&solve(&scene, &display, &vulkan, settings));
    // SAFETY: Everything to which the structures point exists until the calls return. The objects of Vulkan are
    // destroyed last.
    unsafe {
        let entry = ash::Entry::load().unwrap();
        let about = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_2);
        let instance =
            entry.create_instance(&vk::InstanceCreateInfo::default().application_info(&about), None).unwrap();
        let physical = instance.enumerate_physical_devices().unwrap()[0];
        let families = instance.get_physical_device_queue_family_properties(physical);
        let family = families.iter().position(|f| f.queue_flags.contains(vk::QueueFlags::COMPUTE)).unwrap() as u32;
        let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&[1.0])];
        let mut timeline = vk::PhysicalDeviceTimelineSemaphoreFeatures::default().timeline_semaphore(true);
        let info = vk::DeviceCreateInfo::default().queue_create_infos(&queues).push_next(&mut timeline);
        let device = instance.create_device(physical, &info, None).unwrap();
        let queue = device.get_device_queue(family, 0);
        let at = |handle: u64| handle as *mut c_void;
        let of = [instance.handle().as_raw(), physical.as_raw(), device.handle().as_raw(), queue.as_raw()].map(at);
        let open = |of: [*mut c_void; 4], family: u32| {
            handle(|out| eyebox_engine_vulkan_device(of[0], of[1], of[2], family, of[3], Some(out)))
        };
        refused(open([of[0], of[1], null_mut(), of[3]], family), "null device");
        refused(open(of, 999), "engine/unsuitable 999");
        let own = open(of, family).unwrap();
        // The engine on the caller's device has a reason of its own, unlike the library's device and the CPU.
        let reason = |of| CStr::from_ptr(made(|out| eyebox_engine_reason(Some(of), Some(out))).unwrap()).to_owned();
        assert!(!reason(&own).is_empty() && reason(&own) != reason(&vulkan) && reason(&own) != reason(&cpu));
        assert_eq!(phases(&solve(&scene, &display, &own, settings)), theirs);
        let mut times = 0u32;
        let user = std::ptr::from_mut(&mut times).cast::<c_void>();
        assert_eq!(eyebox_engine_with_queue(Some(&own), Some(waits), user), EyeboxStatus::Ok);
        assert_eq!(eyebox_engine_with_queue(Some(&cpu), Some(waits), user), EyeboxStatus::Argument);
        assert_eq!(times, 1);
        drop(own);
        device.destroy_device(None);
        instance.destroy_instance(None);
    }
}
