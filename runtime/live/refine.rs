//! The thread that refines: for every set that can still be reached, where the pupil will be, steps until it has to be
//! handed over, and the set.

use super::{BeatCell, Giver, LiveError, LiveSource, Made, Stamps, Steerer, Watch, aim_of, as_ns, handover};
use crate::encode::{Encoder, PhaseSet};
use crate::playback::Lane;
use crate::present::{Clock, RealClock};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// What a live hologram is started with.
pub struct LiveOptions {
    /// The player's clock.
    pub clock: RealClock,
    /// The display's beat; whoever presents tells it ([`BeatCell::decided`]).
    pub beat: Arc<BeatCell>,
    /// From the beginning of a set to the middle of its light.
    pub light_after: Duration,
    /// Steers from the beginning.
    pub steered: bool,
    /// Sets carry their phases, for somebody who looks at them too.
    pub with_phases: bool,
    /// Makes the engines again when one was lost, and all that is on them.
    pub again: Box<dyn FnMut() -> Result<Steerer, LiveError> + Send>,
    /// What the thread does, for a trace.
    pub lane: Lane,
}

/// Slack before a set is decided on: handing over takes no time, but threads wake late.
const SLACK: Duration = Duration::from_micros(500);
/// A lost engine is made anew so often.
const ATTEMPTS: u32 = 3;

struct Shared {
    stop: AtomicBool,
    steered: AtomicBool,
    restarts: AtomicU64,
    steps: AtomicU64,
}

/// A hologram that is refined on its thread; dropped, it stops.
pub struct Live {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<Lane>>,
}

impl Live {
    /// Whether the hologram follows the eye; if not, the one for the whole eyebox is shown.
    pub fn steer(&self, steered: bool) {
        self.shared.steered.store(steered, Ordering::Release);
    }

    /// Whether it does.
    pub fn is_steered(&self) -> bool {
        self.shared.steered.load(Ordering::Acquire)
    }

    /// How often it began again with the hologram for the whole eyebox, and how many steps it took.
    pub fn counts(&self) -> [u64; 2] {
        [self.shared.restarts.load(Ordering::Relaxed), self.shared.steps.load(Ordering::Relaxed)]
    }

    /// Whether the thread is still there.
    pub fn is_running(&self) -> bool {
        self.thread.as_ref().is_some_and(|t| !t.is_finished())
    }

    /// Ends the thread: what it did.
    pub fn stop(mut self) -> Option<Lane> {
        self.shared.stop.store(true, Ordering::Release);
        self.thread.take().and_then(|t| t.join().ok())
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Starts refining. The first set, the hologram for the whole eyebox, is ready when this returns.
///
/// # Errors
/// Those of the engines and of the encoder; [`LiveError::Setting`] where the system gives no thread.
pub fn start(
    steerer: Steerer,
    encoder: Encoder,
    watch: Arc<Watch>,
    options: LiveOptions,
) -> Result<(Live, LiveSource), LiveError> {
    let (giver, source) = handover(&encoder.frames());
    let shared = Arc::new(Shared {
        stop: AtomicBool::new(false),
        steered: AtomicBool::new(options.steered),
        restarts: AtomicU64::new(0),
        steps: AtomicU64::new(0),
    });
    let theirs = Arc::clone(&shared);
    let encoding = Duration::ZERO;
    let mut refining = Refining { steerer, encoder, watch, options, giver, shared: theirs, number: 0, encoding };
    // Twice: the first time takes longer than any other.
    refining.hand_over(Stamps::default(), [0.0; 2], 0)?;
    refining.hand_over(Stamps::default(), [0.0; 2], 0)?;
    let thread = std::thread::Builder::new()
        .name("eyebox refines".into())
        .spawn(move || refining.live())
        .map_err(|e| LiveError::Setting(format!("no thread for the refinement: {e}")))?;
    Ok((Live { shared, thread: Some(thread) }, source))
}

struct Refining {
    steerer: Steerer,
    encoder: Encoder,
    watch: Arc<Watch>,
    options: LiveOptions,
    giver: Giver,
    shared: Arc<Shared>,
    number: u64,
    /// What reading back, encoding and handing over takes.
    encoding: Duration,
}

impl Refining {
    fn live(mut self) -> Lane {
        let _words = self.giver.last_words("refinement has ended by a fault of its own; the picture stays");
        for _ in 0..ATTEMPTS {
            let Err(error) = self.run() else { return self.options.lane };
            match (self.options.again)() {
                Ok(steerer) => {
                    self.giver.tell(format!("refinement begins anew: {error}"));
                    self.steerer = steerer;
                }
                Err(_) => {
                    self.giver.tell(format!("refinement has ended: {error}; the picture stays"));
                    return self.options.lane;
                }
            }
        }
        self.giver.tell(format!("refinement has ended: it failed {ATTEMPTS} times; the picture stays"));
        self.options.lane
    }

    /// Until it is stopped.
    fn run(&mut self) -> Result<(), LiveError> {
        let (clock, after) = (self.options.clock, as_ns(self.options.light_after));
        let mut whole = true;
        while !self.shared.stop.load(Ordering::Acquire) {
            let beat = self.options.beat.get();
            let now_ns = clock.now_ns();
            let ends = as_ns(self.encoding + SLACK);
            let target = beat.reachable(now_ns, as_ns(self.steerer.round()) + ends);
            if !self.shared.steered.load(Ordering::Acquire) {
                if !whole {
                    self.steerer.restart()?;
                    let now = clock.now_ns();
                    let stamps =
                        Stamps { refine_start_ns: now, aimed_ns: now, refine_end_ns: now, ..Stamps::default() };
                    self.hand_over(Stamps { predicted_light_ns: target.start_ns + after, ..stamps }, [0.0; 2], 0)?;
                    whole = true;
                }
                // Nothing to do but to look again in a while.
                std::thread::sleep(Duration::from_millis(5));
                continue;
            }
            whole = false;
            let light_ns = target.start_ns.saturating_add(after);
            let begun = Instant::now();
            let before = self.steerer.counts();
            let left = target.hand_over_ns.saturating_sub(ends).saturating_sub(now_ns);
            let deadline = begun + Duration::from_nanos(u64::try_from(left).unwrap_or(0));
            // Every round looks again where the pupil will be: samples come while it refines.
            let (mut steps, mut aimed, mut expected) = (0, begun, self.watch.expect(clock.monotonic_ns(light_ns)));
            loop {
                self.steerer.aim(aim_of(&expected.pupil))?;
                let taken = self.steerer.round_until(deadline)?;
                steps += taken;
                if taken == 0 || Instant::now() + self.steerer.round() > deadline {
                    break;
                }
                aimed = Instant::now();
                expected = self.watch.expect(clock.monotonic_ns(light_ns));
            }
            self.options.lane.span("refine", self.number, begun);
            let after = self.steerer.counts();
            self.shared.restarts.fetch_add(after[0] - before[0], Ordering::Relaxed);
            self.shared.steps.fetch_add(u64::from(steps), Ordering::Relaxed);
            let [sample, decoded, filtered] =
                [0, 1, 2].map(|i| expected.sample_ns.map(|s| clock.at_monotonic_ns(s[i])));
            let stamps = Stamps {
                sample_ns: sample,
                decoded_ns: decoded,
                filtered_ns: filtered,
                refine_start_ns: clock.at_ns(begun),
                aimed_ns: clock.at_ns(aimed),
                refine_end_ns: clock.now_ns(),
                handed_over_ns: 0,
                predicted_light_ns: light_ns,
            };
            if steps > 0 {
                self.hand_over(stamps, expected.pupil.centre, steps)?;
            } else {
                // The time was too short for a step: the next set is for the one after.
                std::thread::sleep(SLACK);
            }
        }
        Ok(())
    }

    fn hand_over(&mut self, stamps: Stamps, pupil: [f64; 2], steps: u32) -> Result<(), LiveError> {
        let begun = Instant::now();
        let Some(mut frames) = self.giver.buffer() else { return Ok(()) };
        let phases = self.steerer.phases()?;
        self.encoder.encode_into(&PhaseSet::trusted(&phases), &mut frames)?;
        let stamps = Stamps { handed_over_ns: self.options.clock.now_ns(), ..stamps };
        let phases = self.options.with_phases.then(|| phases.iter().map(|p| Arc::new(p.to_vec())).collect());
        self.giver.give(Made { number: self.number, frames, stamps, pupil, steps, phases });
        self.options.lane.span("encode", self.number, begun);
        self.number += 1;
        let took = begun.elapsed();
        self.encoding = if took > self.encoding { took } else { self.encoding.mul_f64(0.9) + took.mul_f64(0.1) };
        Ok(())
    }
}
