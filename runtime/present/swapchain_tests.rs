//! Tests a swapchain on a virtual X server, with its picture and with failures of the driver or the server.

#![allow(unsafe_code)]

use super::surface::WindowHandle;
use super::swapchain::{Policy, Swapchain};
use super::timing::{PresentTiming, present_number};
use ash::vk::{self, Result as Code};
use eyebox_base::error::ErrorData;
use eyebox_base::steady;
use eyebox_compute::engine::vulkan::VulkanEncoder;
use eyebox_compute::gpu::presentation::{
    FIRST_PIXEL_OUT, PastTimingInfo, PastTimings, PresentWait2Info, StageTime, TimeDomains, TimingCalls,
};
use eyebox_compute::gpu::{EngineError, Gpu, Options, PixelOrder};
use eyebox_optics::{Color, Display};
use eyebox_solve::encode::{Encoder, PhaseSet};
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use x11rb::connection::Connection;
use x11rb::protocol::xproto::{ConfigureWindowAux, ConnectionExt, CreateWindowAux, ImageFormat, WindowClass};
use x11rb::xcb_ffi::XCBConnection;

const SIZE: [usize; 2] = [24, 40];

/// A server with a window. It ends when the value is dropped.
struct Desk {
    server: Child,
    connection: XCBConnection,
    window: u32,
}

impl Desk {
    fn new() -> Self {
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "80x60x24", "-nolisten", "tcp", "-noreset"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb, which tools/setup.sh installs");
        let mut number = String::new();
        BufReader::new(server.stdout.take().expect("its output")).read_line(&mut number).expect("its number");
        let name = std::ffi::CString::new(format!(":{}", number.trim())).expect("a name");
        let (connection, screen) = XCBConnection::connect(Some(&name)).expect("a connection");
        let root = &connection.setup().roots[screen];
        let window = connection.generate_id().expect("a number");
        let [height, width] = SIZE.map(|n| n as u16);
        let (depth, visual) = (root.root_depth, root.root_visual);
        let class = WindowClass::INPUT_OUTPUT;
        connection
            .create_window(depth, window, root.root, 0, 0, width, height, 0, class, visual, &CreateWindowAux::new())
            .and_then(|_| connection.map_window(window))
            .expect("a window");
        connection.sync_();
        Self { server, connection, window }
    }

    fn swapchain(&self, validation: bool) -> Swapchain {
        let handle = WindowHandle::Xcb { connection: self.connection.get_raw_xcb_connection(), window: self.window };
        let options = Options { allow_cpu: true, present: true, validation, ..Options::default() };
        let gpu = Gpu::open(&options).unwrap_or_else(|e| panic!("{e}"));
        // SAFETY: the connection outlives the swapchain.
        unsafe { Swapchain::open(&gpu, handle, Policy::Exact(SIZE)) }.unwrap_or_else(|e| panic!("{e}"))
    }

    /// True if the window shows this picture, (row, column, channel), in time.
    fn shows(&self, picture: &[u8]) -> bool {
        let [height, width] = SIZE.map(|n| n as u16);
        let since = Instant::now();
        while since.elapsed() < Duration::from_secs(20) {
            let image = self.connection.get_image(ImageFormat::Z_PIXMAP, self.window, 0, 0, width, height, u32::MAX);
            let data = image.expect("asked").reply().expect("a picture").data;
            if data.chunks_exact(4).flat_map(|p| [p[2], p[1], p[0]]).eq(picture.iter().copied()) {
                return true;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        false
    }
}

trait Synced {
    fn sync_(&self);
}

impl Synced for XCBConnection {
    fn sync_(&self) {
        self.get_input_focus().expect("asked").reply().expect("an answer");
    }
}

impl Drop for Desk {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

fn picture(seed: usize) -> Vec<u8> {
    (0..3 * SIZE[0] * SIZE[1]).map(|i| ((i + 1) * (2 * seed + 7) % 251) as u8).collect()
}

fn quiet(swapchain: Swapchain) {
    let messages = swapchain.gpu().messages();
    drop(swapchain);
    let heard = messages.lock().unwrap_or_else(PoisonError::into_inner);
    assert!(heard.is_empty(), "{}", heard.join("\n"));
}

#[test]
fn a_swapchain_that_is_no_longer_right_is_made_again_and_shows_the_picture() {
    let desk = Desk::new();
    let mut swapchain = desk.swapchain(true);
    let (lost, date) = (Code::ERROR_SURFACE_LOST_KHR, Code::ERROR_OUT_OF_DATE_KHR);
    let cases: [&[(&str, Code)]; 9] = [
        &[],
        &[("acquire", date)],
        &[("acquire", lost)],
        &[("acquire", Code::TIMEOUT)],
        &[("acquire", date), ("acquire", lost)],
        &[("present", date)],
        &[("present", lost)],
        &[("present", Code::SUBOPTIMAL_KHR), ("present", Code::SUBOPTIMAL_KHR), ("present", Code::SUBOPTIMAL_KHR)],
        &[],
    ];
    for (case, faults) in cases.into_iter().enumerate() {
        swapchain.pretended.extend(faults);
        for i in 0..4 {
            let picture = picture(10 * case + i);
            swapchain.upload(&picture).unwrap_or_else(|e| panic!("{faults:?}: {e}"));
            swapchain.present((4 * case + i) as u64).unwrap_or_else(|e| panic!("{faults:?}: {e}"));
            assert!(desk.shows(&picture), "{faults:?}: picture {i}");
        }
        assert!(swapchain.pretended.is_empty(), "{faults:?}");
    }
    assert!(swapchain.describe().contains(swapchain.timed_by()), "{}", swapchain.describe());
    quiet(swapchain);
}

#[test]
fn what_cannot_be_made_right_is_an_error_that_says_what_happened() {
    let desk = Desk::new();
    let lost = Code::ERROR_SURFACE_LOST_KHR;
    for (faults, what) in [
        (vec![("acquire", Code::ERROR_DEVICE_LOST)], "device-lost"),
        (vec![("present", Code::ERROR_DEVICE_LOST)], "device-lost"),
        (vec![("acquire", lost); 3], "screen-lost"),
        (vec![("acquire", Code::ERROR_OUT_OF_DATE_KHR); 3], "screen-lost"),
        (vec![("acquire", Code::TIMEOUT); 2], "screen-lost"),
        (vec![("acquire", Code::ERROR_OUT_OF_HOST_MEMORY)], "vulkan"),
    ] {
        let mut swapchain = desk.swapchain(true);
        swapchain.pretended.extend(&faults);
        let error = swapchain.upload(&picture(1)).and_then(|()| swapchain.present(0)).expect_err("a fault");
        assert_eq!(ErrorData::of(&error).code, what, "{faults:?}: {error}");
        quiet(swapchain);
    }
}

#[test]
fn after_a_failure_it_is_refused_or_right_and_never_undefined() {
    let desk = Desk::new();
    let mut swapchain = desk.swapchain(true);
    let put = |swapchain: &mut Swapchain, id: u64| {
        swapchain.upload(&picture(id as usize)).and_then(|()| swapchain.present(id))
    };
    put(&mut swapchain, 0).expect("shown");
    // No picture was taken, so commands in flight are not recorded again.
    for _ in 0..3 {
        let error = swapchain.present(1).expect_err("no picture");
        assert!(matches!(error, EngineError::Mismatch { .. }), "{error}");
    }
    // A swapchain that could not be made again is made again the next time, and then shows the right picture.
    let full = Code::ERROR_OUT_OF_DEVICE_MEMORY;
    swapchain.pretended.extend([("acquire", Code::ERROR_OUT_OF_DATE_KHR), ("create", full)]);
    assert!(put(&mut swapchain, 2).is_err(), "no memory");
    swapchain.pretended.extend([("create", full)]);
    assert!(put(&mut swapchain, 3).is_err(), "there is none to present to");
    put(&mut swapchain, 4).expect("made again");
    assert!(desk.shows(&picture(4)));
    // After a failed submission, the next one does not wait in vain.
    for fault in [Code::ERROR_OUT_OF_HOST_MEMORY, full] {
        swapchain.pretended.extend([("submit", fault)]);
        assert!(put(&mut swapchain, 5).is_err());
        assert!(swapchain.present(6).is_err(), "its picture went with it");
        for id in 7..10 {
            put(&mut swapchain, id).unwrap_or_else(|e| panic!("{fault:?}: {e}"));
            assert!(desk.shows(&picture(id as usize)), "{fault:?}: picture {id}");
        }
    }
    quiet(swapchain);
}

#[test]
fn a_picture_on_the_device_is_shown_without_the_host() {
    let desk = Desk::new();
    let mut swapchain = desk.swapchain(true);
    let display = Display { height: SIZE[0], width: SIZE[1], ..Display::preset("planes24").expect("a preset") };
    let encoder = Encoder::new(&display, &[Color::Red], 24).expect("an encoder");
    let mut device = VulkanEncoder::new(swapchain.gpu(), encoder.plan()).expect("its twin");
    let mut pictures = device.pictures(swapchain.pixel_order()).expect("room");
    for round in 0..3 {
        let phases: Vec<f32> =
            (0..24 * SIZE[0] * SIZE[1]).map(|i| (i * (37 + round) % 1001) as f32 * 0.02 - 10.0).collect();
        let frames = encoder.encode(&PhaseSet::trusted(&[&phases])).expect("encoded");
        device.upload(&[&phases]).and_then(|()| device.encode_uploaded()).expect("encoded there");
        device.draw(&mut pictures).expect("drawn");
        let before = swapchain.gpu().counts();
        swapchain.take(&pictures, 0).and_then(|()| swapchain.present(3 * round as u64)).expect("shown");
        assert!(pictures.in_use() && desk.shows(frames.frame(0)));
        // The device here has one queue. A driver that waits for the copy while it presents would block kernels.
        assert!(swapchain.gpu().device.shares_queue());
        assert_eq!(swapchain.copied_first.get(), Some(true));
        let after = swapchain.gpu().counts();
        assert_eq!((before.read_back, before.uploaded), (after.read_back, after.uploaded));
        // Pictures from the host follow, and release it.
        for i in 1..3 {
            swapchain.upload(&picture(i)).and_then(|()| swapchain.present((3 * round + i) as u64)).expect("shown");
        }
        assert!(!pictures.in_use() && desk.shows(&picture(2)));
    }
    let order = if swapchain.pixel_order() == PixelOrder::Bgra { PixelOrder::Rgba } else { PixelOrder::Bgra };
    let others = device.pictures(order).expect("room");
    let refused = [swapchain.take(&others, 0), swapchain.take(&pictures, 1)];
    assert!(refused.iter().all(|r| matches!(r, Err(EngineError::Mismatch { .. }))), "{refused:?}");
    drop((device, pictures, others));
    quiet(swapchain);
}

/// The wait for submissions has a limit. Beyond it the device is lost, and the objects that it may still use are not
/// destroyed.
#[test]
fn a_display_that_never_ends_is_lost_after_a_while() {
    let desk = Desk::new();
    let mut swapchain = desk.swapchain(false);
    swapchain.upload(&picture(0)).and_then(|()| swapchain.present(0)).expect("shown");
    swapchain.wait().expect("with the display");
    swapchain.pretended.push_back(("idle", ash::vk::Result::TIMEOUT));
    for _ in 0..2 {
        let error = swapchain.wait().unwrap_err();
        assert!(matches!(error, EngineError::DeviceLost { .. }), "{error}");
    }
    assert!(swapchain.gpu().device.is_stuck());
}

/// Presents until it fails, and returns the error.
fn until_it_fails(swapchain: &mut Swapchain) -> EngineError {
    let since = Instant::now();
    for id in 1.. {
        let done = swapchain.upload(&picture(id as usize % 9)).and_then(|()| swapchain.present(id));
        if let Err(error) = done {
            return error;
        }
        assert!(since.elapsed() < Duration::from_secs(30), "it went on");
        std::thread::sleep(Duration::from_millis(2));
    }
    unreachable!()
}

#[test]
fn a_window_of_another_size_is_refused_while_it_shows() {
    let desk = Desk::new();
    let mut swapchain = desk.swapchain(false);
    swapchain.upload(&picture(0)).and_then(|()| swapchain.present(0)).expect("shown");
    desk.connection.configure_window(desk.window, &ConfigureWindowAux::new().width(48)).expect("sent");
    desk.connection.sync_();
    let text = until_it_fails(&mut swapchain).to_string();
    assert!(text.contains("24x48") && text.contains("24x40"), "{text}");
}

#[test]
fn a_window_that_was_destroyed_and_a_server_that_ended_are_errors() {
    let desk = Desk::new();
    let mut swapchain = desk.swapchain(false);
    swapchain.upload(&picture(0)).and_then(|()| swapchain.present(0)).expect("shown");
    desk.connection.destroy_window(desk.window).expect("sent");
    desk.connection.sync_();
    let error = until_it_fails(&mut swapchain);
    assert!(matches!(error, EngineError::ScreenLost { .. }), "{error}");
    drop(swapchain);
    let mut desk = Desk::new();
    let mut swapchain = desk.swapchain(false);
    swapchain.upload(&picture(0)).and_then(|()| swapchain.present(0)).expect("shown");
    desk.server.kill().expect("killed");
    desk.server.wait().expect("ended");
    let error = until_it_fails(&mut swapchain);
    assert!(matches!(error, EngineError::ScreenLost { .. }), "{error}");
}

/// Pictures up to this number are out.
static OUT: AtomicU64 = AtomicU64::new(0);

unsafe extern "system" fn wait(_: vk::Device, _: vk::SwapchainKHR, number: u64, timeout: u64) -> Code {
    if number > OUT.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_nanos(timeout.min(1_000_000)));
        return Code::TIMEOUT;
    }
    // A picture is out at the next refresh, if a caller waits for it.
    std::thread::sleep(Duration::from_millis(if timeout > 0 { 2 } else { 0 }));
    Code::SUCCESS
}

unsafe extern "system" fn wait2(
    device: vk::Device,
    swapchain: vk::SwapchainKHR,
    info: *const PresentWait2Info,
) -> Code {
    // SAFETY: The caller passes a valid structure.
    let info = unsafe { *info };
    // SAFETY: The function uses neither handle.
    unsafe { wait(device, swapchain, info.present_id, info.timeout) }
}

/// The driver here has no `VK_KHR_present_wait`, so another function replaces the driver's.
#[test]
fn pictures_are_waited_for_one_at_a_time_and_told_in_order() {
    let desk = Desk::new();
    let mut swapchain = desk.swapchain(false);
    swapchain.times.pretend_present_wait(wait);
    assert_eq!(swapchain.timed_by(), "VK_KHR_present_wait");
    waits_in_order(swapchain);
    let mut swapchain = desk.swapchain(false);
    swapchain.times.pretend_present_wait2(wait2);
    assert_eq!(swapchain.timed_by(), "VK_KHR_present_wait2");
    waits_in_order(swapchain);
}

fn waits_in_order(mut swapchain: Swapchain) {
    let put = |swapchain: &mut Swapchain, id: u64| {
        let since = steady::now_ns();
        swapchain.upload(&picture(0)).and_then(|()| swapchain.present(id)).expect("shown");
        let told: Vec<u64> = std::iter::from_fn(|| swapchain.timing())
            .map(|PresentTiming { id, time_ns }| {
                assert!((since..=steady::now_ns()).contains(&time_ns), "{time_ns}");
                id
            })
            .collect();
        told
    };
    OUT.store(present_number(0), Ordering::Relaxed);
    assert_eq!(put(&mut swapchain, 0), [0]);
    // A picture that takes longer is checked after the next one. If two are out at once, the time of the second is
    // unknown.
    assert!(put(&mut swapchain, 1).is_empty());
    OUT.store(present_number(2), Ordering::Relaxed);
    assert_eq!(put(&mut swapchain, 2), [1]);
    OUT.store(present_number(3), Ordering::Relaxed);
    assert_eq!(put(&mut swapchain, 3), [3]);
    // The times of pictures that a replaced swapchain had queued are unknown.
    assert!(put(&mut swapchain, 4).is_empty());
    swapchain.remake().expect("made again");
    OUT.store(present_number(5), Ordering::Relaxed);
    assert_eq!(put(&mut swapchain, 5), [5]);
}

/// Results of `VK_EXT_present_timing` that the driver has, with the number of a picture and its time, ns.
static RESULTS: Mutex<Vec<(u64, u64)>> = Mutex::new(Vec::new());
/// The clocks of the driver, as time domains.
static CLOCKS: Mutex<Vec<vk::TimeDomainKHR>> = Mutex::new(Vec::new());

unsafe extern "system" fn size(_: vk::Device, _: vk::SwapchainKHR, size: u32) -> Code {
    if size >= 16 { Code::SUCCESS } else { Code::ERROR_UNKNOWN }
}

unsafe extern "system" fn domains(_: vk::Device, _: vk::SwapchainKHR, all: *mut TimeDomains, _: *mut u64) -> Code {
    let clocks = CLOCKS.lock().unwrap();
    // SAFETY: The caller has room for as many domains as it states.
    unsafe {
        let room = std::mem::replace(&mut (*all).count, clocks.len() as u32);
        assert!(room as usize >= clocks.len());
        for (i, clock) in clocks.iter().enumerate() {
            (*(*all).domains.add(i), *(*all).ids.add(i)) = (*clock, 40 + i as u64);
        }
    }
    Code::SUCCESS
}

unsafe extern "system" fn past(_: vk::Device, _: *const PastTimingInfo, all: *mut PastTimings) -> Code {
    let results: Vec<_> = std::mem::take(&mut *RESULTS.lock().unwrap());
    // SAFETY: The caller has room for as many results as it states, each with one stage.
    unsafe {
        assert!((*all).count as usize >= results.len());
        (*all).count = results.len() as u32;
        for (i, (present_id, time)) in results.iter().enumerate() {
            let timing = &mut *(*all).timings.add(i);
            assert_eq!(timing.stage_count, 1);
            *timing.stages = StageTime { stage: FIRST_PIXEL_OUT, time: *time };
            (timing.present_id, timing.time_domain_id, timing.is_complete) = (*present_id, 41, vk::TRUE);
        }
    }
    Code::SUCCESS
}

/// The driver here has no `VK_EXT_present_timing`, so other functions replace the driver's.
#[test]
fn times_of_light_come_from_the_driver_if_they_are_on_the_clock_of_the_system() {
    let desk = Desk::new();
    let mut swapchain = desk.swapchain(false);
    let calls = TimingCalls { set_queue_size: size, domains, past };
    *CLOCKS.lock().unwrap() = vec![vk::TimeDomainKHR::DEVICE, vk::TimeDomainKHR::CLOCK_MONOTONIC];
    swapchain.pretend_present_timing(calls, FIRST_PIXEL_OUT);
    assert_eq!(swapchain.timed_by(), "VK_EXT_present_timing");
    let put = |swapchain: &mut Swapchain, id: u64| {
        swapchain.upload(&picture(0)).and_then(|()| swapchain.present(id)).expect("shown");
        std::iter::from_fn(|| swapchain.timing()).map(|light| (light.id, light.time_ns)).collect::<Vec<_>>()
    };
    assert_eq!(put(&mut swapchain, 0), []);
    // Results come later, several at once. A picture that was never shown has the time 0.
    *RESULTS.lock().unwrap() = vec![(1, 7_000)];
    assert_eq!(put(&mut swapchain, 1), [(0, 7_000)]);
    *RESULTS.lock().unwrap() = vec![(2, 8_000), (3, 0)];
    assert_eq!(put(&mut swapchain, 2), [(1, 8_000)]);
    // While no results come, no more than 16 times are requested, because the driver would refuse the picture.
    for id in 3..19 {
        assert!(swapchain.times.request().is_some(), "{id}");
        assert_eq!(put(&mut swapchain, id), []);
    }
    assert!(swapchain.times.request().is_none());
    *RESULTS.lock().unwrap() = vec![(4, 9_000), (19, 9_500)];
    assert_eq!(put(&mut swapchain, 19), [(3, 9_000), (18, 9_500)]);
    assert!(swapchain.times.request().is_some_and(|request| (request.time_domain_id, request.stages) == (41, 4)));
    // Without the clock of the system the times are useless.
    *CLOCKS.lock().unwrap() = vec![vk::TimeDomainKHR::DEVICE];
    swapchain.pretend_present_timing(calls, FIRST_PIXEL_OUT);
    assert_eq!(swapchain.timed_by(), "the time of acquiring");
}
