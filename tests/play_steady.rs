//! The steady state of playing, all threads counted, encoded by the CPU and by a Vulkan device: no set allocates, memory
//! stays, every set is accounted for. (What a driver allocates of its own is not counted, but stays within the memory.)
//!
//! A minute at 60 Hz of simulated time; `EYEBOX_SOAK=full` makes it ten.

#![allow(unsafe_code)]

use eyebox::encode::{Encoder, PhaseSet};
use eyebox::gpu::{Gpu, Options as GpuOptions};
use eyebox::hologram::{ColorHologram, Hologram, Sequence, SequenceWriter};
use eyebox::optics::Display;
use eyebox::playback::{
    Cause, Clock, Flow, Marks, Offscreen, Options, Player, Rate, SECOND_NS, Schedule, Scheduler, SimulatedClock,
    Source, Speed, Start, Stream, StreamEncoder, Trace,
};
use std::alloc::{GlobalAlloc, Layout, System};
use std::rc::Rc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Counts what every thread allocates.
struct Counting;

static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);

// SAFETY: the system's allocator, called as it is.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        // SAFETY: the caller's promises are passed on.
        unsafe { System.dealloc(at, layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.realloc(at, layout, size) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

fn hologram(index: u64, display: &Display) -> Hologram {
    let pixels = 8 * display.height * display.width;
    let color = |c: &eyebox::optics::Wavelength| ColorHologram {
        color: Some(c.color),
        wavelength: c.wavelength,
        exposure: 0.4,
        efficiency: 0.4,
        phases: (0..pixels as u64).map(|i| ((i * 7 + index * 13) % 62) as f32 * 0.1 - 3.0).collect(),
    };
    Hologram::on(display, 8, display.wavelengths.iter().map(color).collect())
}

/// Pages in memory, where the system tells.
fn resident() -> Option<f64> {
    std::fs::read_to_string("/proc/self/statm").ok()?.split_whitespace().nth(1)?.parse().ok()
}

/// One after the other: allocations of all threads are counted.
#[test]
fn playing_allocates_nothing_and_accounts_for_every_set() {
    play("the CPU", StreamEncoder::Cpu);
    let cache = Some(std::env::temp_dir().join("eyebox-tests"));
    let options = GpuOptions { allow_cpu: true, cache, ..GpuOptions::default() };
    play("Vulkan", |encoder| StreamEncoder::Vulkan(encoder, Gpu::open(&options).expect("a device")));
}

fn play(what: &str, engine: impl FnOnce(Encoder) -> StreamEncoder) {
    let seconds = if std::env::var("EYEBOX_SOAK").is_ok_and(|v| v == "full") { 600 } else { 60 };
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
    let rate = Rate::parse("60").expect("a rate");
    let schedule = Schedule {
        display_rate: rate,
        content_rate: rate,
        speed: Speed::ONE,
        set_frames: 1,
        start: Start::WhenReady { idle_sets: 4 },
        keep_phase: false,
    };
    let clock: Rc<dyn Clock> = Rc::new(SimulatedClock::default());
    let idle = encoder.frames();
    let mut offscreen = Offscreen::new(Rc::clone(&clock), rate, idle.frame_bytes());
    let trace = Trace::new(0);
    let options =
        Options { ahead: 4, looped: true, follow: false, first: 0, threads: 2, marks: Marks { side: 0 }, trace };
    let sequence = Sequence::open(&path).expect("opened");
    let mut stream = Stream::start(sequence, engine(encoder), options).expect("started");
    let mut player = Player::new(Rc::clone(&clock), Scheduler::new(schedule), idle, trace.lane(""));
    let (mut wrong, mut next) = (0u64, 0);
    let mut run_until = |player: &mut Player, stream: &mut Stream, time_ns: i64| {
        while clock.now_ns() < time_ns {
            let flow = player.tick(&mut offscreen, stream, &mut |m| {
                if let Some(index) = m.index {
                    // In order, and byte for byte.
                    wrong += u64::from(index != next || m.picture != expected[index as usize]);
                    next = (index + 1) % 7;
                }
                Ok(())
            });
            assert_eq!(flow.expect("no fault"), Flow::Continue);
            assert!(stream.message().is_none());
        }
    };
    run_until(&mut player, &mut stream, 5 * SECOND_NS);
    let memory = resident();
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    run_until(&mut player, &mut stream, (5 + seconds) * SECOND_NS);
    let allocations = ALLOCATIONS.load(Ordering::Relaxed) - before;
    if let (Some(before), Some(after)) = (memory, resident()) {
        assert!((after / before - 1.0).abs() < 0.02, "{what}: {before} pages became {after}");
    }
    assert_eq!(wrong, 0, "{what}: pictures that are not what was encoded");
    assert_eq!(allocations, 0, "{what}: allocations in {seconds} s");
    let a = player.scheduler().account();
    assert_eq!((a.drops(), a.missed_presents, a.repeats), (0, 0, 0), "{a:?}");
    assert_eq!((a.sets, a.video_frames), (a.shown + a.idle_sets, a.sets));
    assert!(a.shown >= 60 * seconds as u64 && a.dropped_for(Cause::LateGpu) == 0, "{a:?}");
    println!("{what}: {} sets in {seconds} s, {} allocations", a.sets, allocations);
}
