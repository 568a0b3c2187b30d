//! The thread that refines: for every set that can still be reached, where the pupil will be, steps until it has to be
//! handed over, and the set.

use super::error::SessionError;
use super::latency::Timestamps;
use super::notes::Notes;
use super::pupil_tracker::PupilTracker;
use super::set_timing::{SetTiming, Target, as_ns};
use super::sets::{FinishedSet, LiveSource};
use super::sets::{SetSender, set_channel};
use super::steerer::Steerer;
use super::trace::Track;
use crate::encode::{Encoder, PhaseSet};
use crate::engine::vulkan::VulkanEncoder;
use crate::gpu::{Gpu, PixelOrder};
use crate::optics::PupilDistribution;
use crate::present::{Clock, RealClock};
use crossbeam_utils::atomic::AtomicCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Makes the engines with all that is on them, and says which device they share, if it is one.
pub(super) type Begin = Box<dyn FnMut() -> Result<(Steerer, Option<Gpu>), SessionError> + Send>;

/// What a refinement is started with.
pub(super) struct RefinementOptions {
    /// The player's clock.
    pub clock: RealClock,
    /// When the display begins sets; who presents says it.
    pub timing: Arc<AtomicCell<SetTiming>>,
    /// From the beginning of a set to the middle of its light.
    pub light_after: Duration,
    /// Whether the hologram follows the eye; if not, the one for the whole eyebox is shown.
    pub steered: Arc<AtomicBool>,
    /// Video frames go straight to a display that shows from the engines' device, in this order of colours.
    pub direct: Option<PixelOrder>,
    /// Sets carry their phases, for somebody who looks at them too.
    pub with_phases: bool,
    /// Makes the engines again when one was lost, and all that is on them.
    pub again: Begin,
    /// Where it says what went wrong.
    pub notes: Notes,
    /// What the thread does, for a trace.
    pub track: Track,
}

/// Slack before a set is decided on: handing over takes no time, but threads wake late.
const SLACK: Duration = Duration::from_micros(500);
/// A lost engine is made anew so often.
const ATTEMPTS: u32 = 3;

#[derive(Default)]
struct Shared {
    stop: AtomicBool,
    restarts: AtomicU64,
    steps: AtomicU64,
}

/// A hologram that is refined on its thread; dropped, it stops.
pub(super) struct Refinement {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<Track>>,
}

impl Refinement {
    /// Starts refining. The first set, the hologram for the whole eyebox, is ready when this returns.
    ///
    /// # Errors
    /// Those of the engines and of the encoder; [`SessionError::Thread`].
    pub(super) fn start(
        encoder: Encoder,
        tracker: Arc<PupilTracker>,
        mut options: RefinementOptions,
    ) -> Result<(Self, LiveSource), SessionError> {
        let (steerer, gpu) = (options.again)()?;
        let device = device_encoder(&steerer, gpu, &encoder)?;
        let (sender, source) = set_channel(&encoder.frames(), || {
            device.as_ref().zip(options.direct).map(|(device, order)| device.pictures(order)).transpose()
        })?;
        let shared = Arc::new(Shared::default());
        let (theirs, encoding) = (Arc::clone(&shared), Duration::ZERO);
        let mut refining =
            Refining { steerer, device, encoder, tracker, options, sender, shared: theirs, number: 0, encoding };
        // Twice: the first time takes longer than any other.
        refining.hand_over(Timestamps::default(), None, 0)?;
        refining.hand_over(Timestamps::default(), None, 0)?;
        let thread = std::thread::Builder::new()
            .name("eyebox refines".into())
            .spawn(move || refining.live())
            .map_err(|e| SessionError::Thread { what: "refines", reason: format!("could not be started ({e})") })?;
        Ok((Self { shared, thread: Some(thread) }, source))
    }

    /// How often it began again with the hologram for the whole eyebox, and how many steps it took.
    pub(super) fn counts(&self) -> [u64; 2] {
        [self.shared.restarts.load(Ordering::Relaxed), self.shared.steps.load(Ordering::Relaxed)]
    }

    /// Whether the thread is still there.
    #[cfg(test)]
    pub(super) fn is_running(&self) -> bool {
        self.thread.as_ref().is_some_and(|t| !t.is_finished())
    }

    /// Ends the thread: what it did.
    pub(super) fn stop(&mut self) -> Option<Track> {
        self.shared.stop.store(true, Ordering::Release);
        self.thread.take().and_then(|t| t.join().ok())
    }
}

impl Drop for Refinement {
    fn drop(&mut self) {
        let _ = self.stop();
    }
}

/// An encoder on the engines' device, if they have one: phases need not come to the host.
fn device_encoder(
    steerer: &Steerer,
    gpu: Option<Gpu>,
    encoder: &Encoder,
) -> Result<Option<VulkanEncoder>, SessionError> {
    let gpu = gpu.filter(|_| steerer.phases_on_device().is_some());
    Ok(gpu.map(|gpu| VulkanEncoder::new(&gpu, encoder.plan())).transpose()?)
}

struct Refining {
    steerer: Steerer,
    device: Option<VulkanEncoder>,
    encoder: Encoder,
    tracker: Arc<PupilTracker>,
    options: RefinementOptions,
    sender: SetSender,
    shared: Arc<Shared>,
    number: u64,
    /// What encoding and handing over takes.
    encoding: Duration,
}

impl Refining {
    fn live(mut self) -> Track {
        let notes = self.options.notes.clone();
        let _note = notes.on_panic("refinement has ended by a fault of its own; the picture stays");
        for _ in 0..ATTEMPTS {
            let Err(error) = self.run() else { return self.options.track };
            let again = (self.options.again)().and_then(|(steerer, gpu)| {
                let device = device_encoder(&steerer, gpu, &self.encoder)?;
                Ok((steerer, device))
            });
            match again {
                Ok((steerer, device)) => {
                    notes.tell(format!("refinement begins anew: {error}"));
                    (self.steerer, self.device) = (steerer, device);
                }
                Err(_) => {
                    notes.tell(format!("refinement has ended: {error}; the picture stays"));
                    return self.options.track;
                }
            }
        }
        notes.tell(format!("refinement has ended: it failed {ATTEMPTS} times; the picture stays"));
        self.options.track
    }

    /// Until it is stopped.
    fn run(&mut self) -> Result<(), SessionError> {
        let mut whole = true;
        while !self.shared.stop.load(Ordering::Acquire) {
            let now_ns = self.options.clock.now_ns();
            let need_ns = as_ns(self.steerer.round() + self.encoding + SLACK);
            let target = self.options.timing.load().reachable(now_ns, need_ns);
            if self.options.steered.load(Ordering::Acquire) {
                whole = false;
                self.refine_for(target, now_ns)?;
                continue;
            }
            if !whole {
                self.steerer.restart()?;
                let now = self.options.clock.now_ns();
                let timestamps = Timestamps {
                    refine_start_ns: now,
                    aimed_ns: now,
                    refine_end_ns: now,
                    predicted_light_ns: target.start_ns + as_ns(self.options.light_after),
                    ..Timestamps::default()
                };
                self.hand_over(timestamps, None, 0)?;
                whole = true;
            }
            // Nothing to do but to look again in a while.
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(())
    }

    /// Steps until the set has to be handed over, and the set.
    fn refine_for(&mut self, target: Target, now_ns: i64) -> Result<(), SessionError> {
        let clock = self.options.clock;
        let light_ns = target.start_ns.saturating_add(as_ns(self.options.light_after));
        let begun = Instant::now();
        let before = self.steerer.counts();
        let left = target.hand_over_ns.saturating_sub(as_ns(self.encoding + SLACK)).saturating_sub(now_ns);
        let deadline = begun + Duration::from_nanos(u64::try_from(left).unwrap_or(0));
        let in_time = |expected: Duration| Instant::now() + expected <= deadline;
        // Every round looks again where the pupil will be: samples come while it refines.
        let (mut steps, mut aimed, mut expected) = (0, begun, self.tracker.expect(clock.monotonic_ns(light_ns)));
        loop {
            self.steerer.aim(expected.pupil)?;
            let taken = self.steerer.round_while(in_time)?;
            steps += taken;
            if taken == 0 || !in_time(self.steerer.round()) {
                break;
            }
            aimed = Instant::now();
            expected = self.tracker.expect(clock.monotonic_ns(light_ns));
        }
        self.steerer.settle()?;
        self.options.track.span("refine", self.number, begun);
        let after = self.steerer.counts();
        self.shared.restarts.fetch_add(after[0] - before[0], Ordering::Relaxed);
        self.shared.steps.fetch_add(u64::from(steps), Ordering::Relaxed);
        if steps == 0 {
            // The time was too short for a step: the next set is for the one after.
            std::thread::sleep(SLACK);
            return Ok(());
        }
        let [sample_ns, decoded_ns, filtered_ns] =
            [0, 1, 2].map(|i| expected.sample_ns.map(|s| clock.at_monotonic_ns(s[i])));
        let timestamps = Timestamps {
            sample_ns,
            decoded_ns,
            filtered_ns,
            refine_start_ns: clock.at_ns(begun),
            aimed_ns: clock.at_ns(aimed),
            refine_end_ns: clock.now_ns(),
            handed_over_ns: 0,
            predicted_light_ns: light_ns,
        };
        self.hand_over(timestamps, Some(expected.pupil), steps)
    }

    /// Encodes what there is, refined for `aim`, and hands it over.
    fn hand_over(
        &mut self,
        timestamps: Timestamps,
        aim: Option<PupilDistribution>,
        steps: u32,
    ) -> Result<(), SessionError> {
        let begun = Instant::now();
        let Some(mut buffer) = self.sender.buffer() else { return Ok(()) };
        match (&mut self.device, self.steerer.phases_on_device()) {
            (Some(device), Some(phases)) => {
                device.encode_on_device(&phases)?;
                match &mut buffer.pictures {
                    Some(pictures) => device.draw(pictures)?,
                    None => device.download(buffer.frames.bytes_mut())?,
                }
            }
            _ => self.encoder.encode_into(&PhaseSet::trusted(&self.steerer.phases()?), &mut buffer.frames)?,
        }
        let timestamps = Timestamps { handed_over_ns: self.options.clock.now_ns(), ..timestamps };
        let pupil = aim.map_or([0.0; 2], |aim| aim.centre);
        let focus = aim.map(|PupilDistribution { focus: [low, high], .. }| 0.5 * (low + high));
        let phases = match self.options.with_phases {
            true => Some(self.steerer.phases()?.iter().map(|p| Arc::new(p.to_vec())).collect()),
            false => None,
        };
        self.sender.send(FinishedSet { number: self.number, buffer, timestamps, pupil, focus, steps, phases });
        self.options.track.span("encode", self.number, begun);
        self.number += 1;
        let took = begun.elapsed();
        self.encoding = if took > self.encoding { took } else { self.encoding.mul_f64(0.9) + took.mul_f64(0.1) };
        Ok(())
    }
}
