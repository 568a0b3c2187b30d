//! Checks the steady state of playing and of refinement over all threads. A refinement on the CPU allocates no memory
//! for a step, a set or an eye sample, except in the queue of work for rayon's threads. Playing allocates no memory for
//! a set, with encoding on the CPU and on a Vulkan device. Memory does not grow, and the statistics cover every set.
//! The allocations of a driver itself are not counted, but they are part of the memory.
//!
//! Playing lasts a minute of simulated time at 60 Hz, or ten minutes with `EYEBOX_SOAK=full`.

#![allow(unsafe_code)]

use eyebox::low_level::encode::{Encoder, PhaseSet};
use eyebox::low_level::engine::cpu::CpuEngine;
use eyebox::low_level::gaze::{self, Estimator};
use eyebox::low_level::gpu::{Gpu, Options as GpuOptions};
use eyebox::low_level::hologram::{ColorHologram, Hologram, SequenceWriter};
use eyebox::low_level::optics::Display;
use eyebox::low_level::present::Rate;
use eyebox::low_level::scene::{self, Request};
use eyebox::low_level::session::{
    Cause, Cost, EngineOpener, Live, Output, Play, Session, SessionEvent, SessionOptions, Tracking,
};
use eyebox::low_level::trackers;
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::sync_channel;
use std::time::Duration;

/// Counts the allocations of all threads.
struct Counting;

static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);
/// Allocated blocks of the queue through which rayon's threads receive work from outside (`Injector` of
/// crossbeam-deque). For every 63 tasks, the queue allocates one block and frees one.
static QUEUE_BLOCKS: AtomicU64 = AtomicU64::new(0);
/// Bytes of a block of this queue.
const QUEUE_BLOCK: usize = 1520;
const TASKS_A_BLOCK: u64 = 63;

// SAFETY: Every call goes to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let counter = if layout.size() == QUEUE_BLOCK { &QUEUE_BLOCKS } else { &ALLOCATIONS };
        counter.fetch_add(1, Ordering::Relaxed);
        // SAFETY: The caller gives the guarantees that the system's allocator requires.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        // SAFETY: The caller gives the guarantees that the system's allocator requires.
        unsafe { System.dealloc(at, layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: The caller gives the guarantees that the system's allocator requires.
        unsafe { System.realloc(at, layout, size) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

fn hologram(index: u64, display: &Display) -> Hologram {
    let pixels = 8 * display.height * display.width;
    let color = |c: &eyebox::low_level::optics::Wavelength| ColorHologram {
        color: Some(c.color),
        wavelength: c.wavelength,
        exposure: 0.4,
        efficiency: 0.4,
        phases: (0..pixels as u64).map(|i| ((i * 7 + index * 13) % 62) as f32 * 0.1 - 3.0).collect(),
    };
    Hologram::on(display, 8, display.wavelengths.iter().map(color).collect())
}

/// Returns the number of pages in memory, if the system reports it.
fn resident() -> Option<f64> {
    std::fs::read_to_string("/proc/self/statm").ok()?.split_whitespace().nth(1)?.parse().ok()
}

/// The sessions run one after the other, because the count covers all threads of the process.
#[test]
fn playing_allocates_nothing_and_accounts_for_every_set() {
    play("the CPU", None);
    let cache = Some(std::env::temp_dir().join("eyebox-tests"));
    let options = GpuOptions { allow_cpu: true, cache, ..GpuOptions::default() };
    play("Vulkan", Some(Gpu::open(&options).expect("a device")));
    refine();
}

/// The largest number of tasks that a step gives to rayon's threads, with its share of a set's encoding.
const TASKS_A_STEP: u64 = 4;

/// Refines a hologram of three colors with a rolling update for a moving eye. This lasts 20 s of simulated time, or ten
/// minutes with `EYEBOX_SOAK=full`.
fn refine() {
    let seconds: u64 = if std::env::var("EYEBOX_SOAK").is_ok_and(|v| v == "full") { 600 } else { 20 };
    let display = Display { height: 40, width: 48, ..Display::preset("planes8").expect("a preset") };
    let colors: Vec<_> = display.wavelengths.iter().map(|w| w.color).collect();
    let field = scene::load("builtin:still-life", &Request::new(&display, &colors)).expect("a scene");
    let estimator = Estimator::new(gaze::Settings::default(), None).expect("the defaults");
    let options = trackers::Options { real_time: false, ..trackers::Options::default() };
    let tracking = Tracking::open(&"simulated:3".parse().expect("a tracker"), &options, estimator).expect("opened");
    let engines: EngineOpener = Box::new(|| Ok(Box::new(CpuEngine::new())));
    let mut live = Live::of_hologram(&hologram(0, &display), &field, &display, engines, tracking).expect("a session");
    live.cost = Cost::Fixed { step: Duration::from_micros(1500), encode: Duration::from_micros(300) };
    let (tell, told) = sync_channel(1);
    let (mut frames, mut begun) = (0u64, ([0; 2], None));
    let last = 180 * (5 + seconds) - 10;
    let observer = move |_: &eyebox::low_level::session::PresentedFrame<'_>| {
        frames += 1;
        if frames == 900 || frames == last {
            let counted = || [&ALLOCATIONS, &QUEUE_BLOCKS].map(|counter| counter.load(Ordering::Relaxed));
            let early = counted();
            let pages = resident();
            let count = if frames == last { early } else { counted() };
            if frames == last {
                let [made, blocks] = [0, 1].map(|i| count[i] - begun.0[i]);
                let _ = tell.try_send((made, blocks, begun.1.zip(pages)));
            }
            begun = (count, pages);
        }
    };
    let mut options = SessionOptions::default();
    options.display_rate = Some(Rate::parse("180").expect("a rate"));
    options.duration = Some(Duration::from_secs(5 + seconds));
    options.observer = Some(Box::new(observer));
    let session = Session::start(live, Output::Memory { simulated: true, sink: None }, options).expect("started");
    let (allocations, blocks, memory) = told.recv().expect("the last seconds");
    let ended = session.stop();
    ended.result.expect("no fault");
    let live = ended.statistics.live.as_ref().expect("refined");
    println!("refined: {} sets, {} steps, {allocations} allocations, {blocks} of a queue", live.sets_new, live.steps);
    assert_eq!(allocations, 0, "allocations in {seconds} s, {} steps", live.steps);
    assert!(blocks * TASKS_A_BLOCK <= TASKS_A_STEP * live.steps, "{blocks} blocks of a queue in {} steps", live.steps);
    if let Some((before, after)) = memory {
        assert!((after / before - 1.0).abs() < 0.02, "{before} pages became {after}");
    }
}

fn play(what: &'static str, device: Option<Gpu>) {
    let seconds: u64 = if std::env::var("EYEBOX_SOAK").is_ok_and(|v| v == "full") { 600 } else { 60 };
    let display = Display { height: 40, width: 48, ..Display::preset("planes24").expect("a preset") };
    let here = tempfile::tempdir().expect("a folder");
    let path = here.path().join("x.zarr");
    let mut writer = SequenceWriter::create(&path, &hologram(0, &display), [60, 1], Some(7)).expect("a sequence");
    (0..7).for_each(|i| writer.append(&hologram(i, &display)).expect("written"));
    writer.finish().expect("finished");

    let colors: Vec<_> = display.wavelengths.iter().map(|w| w.color).collect();
    let encoder = Encoder::new(&display, &colors, 8).expect("an encoder");
    let expected: Vec<Vec<u8>> = (0..7)
        .map(|i| {
            let hologram = hologram(i, &display);
            let slices: Vec<&[f32]> = hologram.colors.iter().map(|c| &c.phases[..]).collect();
            encoder.encode(&PhaseSet::trusted(&slices)).expect("encoded").bytes().to_vec()
        })
        .collect();
    let mut play = Play::open(&path, &display).expect("opened");
    (play.looped, play.device) = (true, device);
    // The observer counts allocations and reads the pages in memory five seconds after the start and at the end.
    let (tell, told) = sync_channel(1);
    let (mut wrong, mut next, mut frames, mut begun) = (0u64, 0, 0u64, (0, None));
    let last = 60 * (5 + seconds) - 10;
    let observer = move |frame: &eyebox::low_level::session::PresentedFrame<'_>| {
        if let Some(index) = frame.index {
            // Every picture must come in order and equal the expected bytes.
            wrong += u64::from(index != next || frame.picture != expected[index as usize]);
            next = (index + 1) % 7;
        }
        frames += 1;
        if frames == 300 || frames == last {
            // A reading of the pages allocates, so the count begins after the first reading and ends before the last.
            let early = ALLOCATIONS.load(Ordering::Relaxed);
            let pages = resident();
            let count = if frames == last { early } else { ALLOCATIONS.load(Ordering::Relaxed) };
            if frames == last {
                let _ = tell.try_send((count - begun.0, begun.1.zip(pages), wrong));
            }
            begun = (count, pages);
        }
    };
    let mut options = SessionOptions::default();
    options.display_rate = Some(Rate::parse("60").expect("a rate"));
    options.duration = Some(Duration::from_secs(5 + seconds));
    options.observer = Some(Box::new(observer));
    let session = Session::start(play, Output::Memory { simulated: true, sink: None }, options).expect("started");
    let (allocations, memory, wrong) = told.recv().expect("the last seconds");
    assert_eq!(wrong, 0, "{what}: pictures differ from the encoded frames");
    assert_eq!(allocations, 0, "{what}: allocations in {seconds} s");
    if let Some((before, after)) = memory {
        assert!((after / before - 1.0).abs() < 0.02, "{what}: {before} pages became {after}");
    }
    assert_eq!(session.event(Duration::from_secs(60)), Some(SessionEvent::Ended));
    let ended = session.stop();
    ended.result.expect("no fault");
    let a = &ended.statistics.report.account;
    assert_eq!((a.drops(), a.missed_presents, a.repeats), (0, 0, 0), "{a:?}");
    assert_eq!((a.sets, a.video_frames), (a.shown + a.idle_sets, a.sets));
    assert!(a.shown >= 60 * seconds && a.dropped_for(Cause::LateGpu) == 0, "{a:?}");
    println!("{what}: {} sets in {seconds} s, {allocations} allocations", a.sets);
}
