//! Refines each reachable multiplex set for the content and the pupil at its light.
//!
//! A round takes steps until the set has to be handed over, and hands it over. Rounds run on a thread, or in simulated
//! time when a set is requested.

mod beginning;
mod handing_over;
mod options;
mod simulated;

pub(crate) use options::{Begin, RefinementOptions};

use crate::encode::Encoder;
use crate::engine::vulkan::VulkanEncoder;
use crate::gpu::Gpu;
use crate::present::{Clock, RealClock};
use crate::session::content::scenes::{Due, FrameFreshness, Newest, SceneFrame};
use crate::session::feeds::journal::{Decision, Journal, Moves};
use crate::session::feeds::sets::{LiveSource, SetSender, set_channel};
use crate::session::feeds::showing::SceneCounts;
use crate::session::frame_log::account::RepeatReason;
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::latency::Timestamps;
use crate::session::frame_log::threads::spawn;
use crate::session::frame_log::trace::Track;
use crate::session::playback::scheduler::Target;
use crate::session::refinement::agreement::Member;
use crate::session::refinement::live_refiner::LiveRefiner;
use crate::session::refinement::set_timing::as_ns;
use crate::session::refinement::work_time::{Cost, Times, WorkTime};
use crossbeam_utils::atomic::AtomicCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The slack before the decision on a set. Handing over takes no time, but threads wake late.
const SLACK: Duration = Duration::from_micros(500);
/// The number of attempts to open a lost engine again. The pause follows a failed attempt, because a driver takes
/// seconds to reset.
const ATTEMPTS: u32 = 3;
const PAUSE: Duration = Duration::from_secs(1);
/// After this many sets an engine counts as working, and its next loss gets all attempts again.
const WORKED_SETS: u64 = 16;

#[derive(Default)]
struct Shared {
    stop: AtomicBool,
    restarts: AtomicU64,
    steps: AtomicU64,
    moving: AtomicU64,
    carried: AtomicU64,
    taken: AtomicCell<SceneCounts>,
}

/// A hologram that is refined, on a thread if time is real. It stops when it is dropped.
pub(crate) struct Refinement {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<Track>>,
}

impl Refinement {
    /// Starts refinement. The first set, of the hologram for the whole eyebox, is ready when this returns, unless the
    /// first scene has not arrived.
    pub(crate) fn start(encoder: Encoder, mut options: RefinementOptions) -> Result<(Self, LiveSource), SessionError> {
        let (refiner, gpu) = (options.again)()?;
        let device = device_encoder(&refiner, gpu, &encoder)?;
        let keeps = if options.pair.is_some() { 2 } else { 1 };
        let (sender, mut source) = set_channel(&encoder.frames(), keeps, || {
            device.as_ref().zip(options.direct).map(|(device, order)| device.pictures(order)).transpose()
        })?;
        let shared = Arc::new(Shared::default());
        let is_real = options.clock.is_some();
        let mut refining = Refining {
            refiner,
            device,
            encoder,
            options,
            sender,
            shared: Arc::clone(&shared),
            number: 0,
            encoding: Duration::ZERO,
            scene: None,
            supply: FrameFreshness::Same,
            told: None,
            building: Duration::ZERO,
            made_ns: i64::MIN,
            looked_ns: 0,
        };
        let scenes = refining.first_of_scenes().map_or(0, |_| 1);
        refining.shared.taken.store(SceneCounts { scenes, ..SceneCounts::default() });
        // Two runs are needed, because the first one compiles. Its time is no measure of later ones.
        for _ in 0..2 {
            refining.encoding = Duration::ZERO;
            let mut time = WorkTime::begin(refining.options.cost, 0);
            if refining.waits() {
                refining.rehearse()?;
            } else {
                // The set is not refined, so its encoding begins now.
                let now_ns = refining.options.clock.map_or(0, |clock| clock.now_ns());
                let [refine_start_ns, aimed_ns, refine_end_ns] = [now_ns; 3];
                let begun = Timestamps { refine_start_ns, aimed_ns, refine_end_ns, ..Timestamps::default() };
                refining.hand_over(begun, None, 0, &mut time)?;
            }
        }
        let mut thread = None;
        if is_real {
            thread = Some(spawn("refines", move || refining.live())?);
        } else {
            source.make = Some(Box::new(refining));
        }
        Ok((Self { shared, thread }, source))
    }

    /// Creates a placeholder for sets that are made elsewhere.
    pub(crate) fn none() -> Self {
        Self { shared: Arc::default(), thread: None }
    }

    pub(crate) fn taken(&self) -> SceneCounts {
        self.shared.taken.load()
    }

    /// Returns the restarts from the hologram for the whole eyebox, the steps, the sets refined for motion, and the
    /// shifts of phases.
    pub(crate) fn counts(&self) -> [u64; 4] {
        let Shared { restarts, steps, moving, carried, .. } = &*self.shared;
        [restarts, steps, moving, carried].map(|count| count.load(Ordering::Relaxed))
    }

    #[cfg(test)]
    pub(crate) fn is_running(&self) -> bool {
        self.thread.as_ref().is_some_and(|t| !t.is_finished())
    }

    /// Ends the thread and returns its track.
    pub(crate) fn stop(&mut self) -> Option<Track> {
        self.shared.stop.store(true, Ordering::Release);
        self.thread.take().and_then(|t| t.join().ok())
    }
}

impl Drop for Refinement {
    fn drop(&mut self) {
        let _ = self.stop();
    }
}

/// Creates an encoder on the device of the engines, if they have one, so that phases need not come to the host.
fn device_encoder(
    refiner: &LiveRefiner,
    gpu: Option<Gpu>,
    encoder: &Encoder,
) -> Result<Option<VulkanEncoder>, SessionError> {
    let gpu = gpu.filter(|_| refiner.phases_on_device().is_some());
    Ok(gpu.map(|gpu| VulkanEncoder::new(&gpu, encoder.plan())).transpose()?)
}

struct Refining {
    refiner: LiveRefiner,
    device: Option<VulkanEncoder>,
    encoder: Encoder,
    options: RefinementOptions,
    sender: SetSender,
    shared: Arc<Shared>,
    number: u64,
    /// The time for encoding and handing over.
    encoding: Duration,
    /// The scene to show, and its freshness.
    scene: Option<SceneFrame>,
    supply: FrameFreshness,
    /// The last note about a skipped scene.
    told: Option<String>,
    /// The time to prepare a scene.
    building: Duration,
    /// In simulated time, the end of the work on sets until now, and the time to compare the losses of the newest
    /// scene.
    made_ns: i64,
    looked_ns: i64,
}

impl Refining {
    fn live(mut self) -> Track {
        let notes = self.options.notes.clone();
        let _note = notes.on_panic("refinement has ended by a fault of its own, and the picture stays");
        let mut left = ATTEMPTS;
        loop {
            let before = self.number;
            let Err(error) = self.run() else { return self.options.track };
            self.sender.does(RepeatReason::EngineLost);
            let _away = self.options.pair.as_ref().map(Member::leave);
            if self.number - before >= WORKED_SETS {
                left = ATTEMPTS;
            }
            // The memory of a lost device is gone, and the next frame brings other views.
            self.scene.take_if(|scene| scene.is_lost());
            let mut reason = error.to_string();
            loop {
                if left == 0 {
                    notes.send(format!("refinement has ended: {reason}, and the picture stays"));
                    return self.options.track;
                }
                left -= 1;
                match self.open_again() {
                    Ok(()) => break,
                    Err(error) => reason = format!("{reason}, and opening the engine again failed: {error}"),
                }
                if left > 0 && !self.pause() {
                    return self.options.track;
                }
            }
            notes.send(format!("refinement starts again: {reason}"));
        }
    }

    /// Opens the engines again, with the current scene.
    fn open_again(&mut self) -> Result<(), SessionError> {
        let (mut refiner, gpu) = (self.options.again)()?;
        match &self.scene {
            Some(SceneFrame { piece: Some(piece), colors, .. }) => drop(refiner.move_to(*piece, colors)?),
            Some(scene) => drop(refiner.follow(&scene.colors)?),
            None => {}
        }
        let device = device_encoder(&refiner, gpu, &self.encoder)?;
        (self.refiner, self.device) = (refiner, device);
        // The first run compiles, as at the start.
        for _ in 0..2 {
            self.rehearse()?;
        }
        self.options.journal.iter().for_each(Journal::break_off);
        self.options.moments.begun_again();
        Ok(())
    }

    /// Waits before another attempt. Returns false if the session stops.
    fn pause(&self) -> bool {
        let begun = Instant::now();
        while begun.elapsed() < PAUSE {
            if self.shared.stop.load(Ordering::Acquire) {
                return false;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        true
    }

    /// Refines on the clock of the system until it is stopped.
    fn run(&mut self) -> Result<(), SessionError> {
        let Some(clock) = self.options.clock else { return Ok(()) };
        let mut whole = true;
        while !self.shared.stop.load(Ordering::Acquire) {
            let target = self.reachable(clock.now_ns());
            let steered = self.refines();
            let Some(changed) = self.look_for_scene(&target, clock.now_ns(), steered)? else { return Ok(()) };
            if self.waits() {
                std::thread::sleep(Duration::from_millis(2));
                continue;
            }
            let Some(target) = self.agreed(steered, clock) else { continue };
            let now_ns = clock.now_ns();
            if steered {
                whole = false;
                self.refine_for(target, now_ns)?;
                continue;
            }
            if !whole || changed {
                self.show_whole(&target, now_ns)?;
                whole = true;
            }
            // There is no work, so the thread looks again after a short time.
            self.sender.does(RepeatReason::Unchanged);
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(())
    }

    /// Returns the next reachable set. Two eyes that show together agree on it, and wait for each other. Returns `None`
    /// if the wait has ended because the session stops or the refinement is switched off.
    fn agreed(&mut self, steered: bool, clock: RealClock) -> Option<Target> {
        let need_ns = self.need_ns();
        let timing = self.options.timing.load();
        let Some(member) = self.options.pair.as_ref().filter(|_| steered) else {
            return Some(timing.reachable(clock.now_ns(), need_ns));
        };
        let goes_on = || !self.shared.stop.load(Ordering::Acquire) && self.refines();
        member.agree(need_ns, |need_ns| timing.reachable(clock.now_ns(), need_ns), goes_on)
    }

    /// Returns true if the first scene has not arrived.
    fn waits(&self) -> bool {
        self.scene.is_none() && self.options.scenes.as_ref().is_some_and(|scenes| !scenes.begins_with_one())
    }

    /// Returns true if sets are refined for the tracked pupil or for the whole eyebox.
    fn refines(&self) -> bool {
        self.options.whole.is_some() || self.options.steered.load(Ordering::Acquire)
    }

    /// Returns the number of the scene that refinement started with, if others follow it.
    fn first_of_scenes(&self) -> Option<u64> {
        self.options.scenes.as_ref().filter(|scenes| scenes.begins_with_one()).map(|_| 0)
    }

    fn round_ns(&self) -> i64 {
        self.options.cost.round_ns(self.refiner.colors(), || self.refiner.round())
    }

    /// Returns the time after the steps (ns).
    fn ends_ns(&self) -> i64 {
        match self.options.cost {
            Cost::Measured => as_ns(self.encoding + SLACK),
            // No thread wakes late in simulated time.
            Cost::Fixed { encode, .. } => as_ns(encode),
        }
    }

    /// Returns the time of a round and of handing its set over.
    fn need_ns(&self) -> i64 {
        self.round_ns().saturating_add(self.ends_ns())
    }

    fn reachable(&self, now_ns: i64) -> Target {
        self.options.timing.load().reachable(now_ns, self.need_ns())
    }

    fn light_ns(&self, target: &Target) -> i64 {
        target.start_ns.saturating_add(as_ns(self.options.light_after))
    }

    /// Takes the scene for the light of this set. Returns true if it is a new one, and `None` if the content has ended.
    fn look_for_scene(&mut self, target: &Target, now_ns: i64, steered: bool) -> Result<Option<bool>, SessionError> {
        let light_ns = self.light_ns(target);
        let times = Times(self.options.clock);
        self.sender.does(RepeatReason::SceneTooLong);
        if self.options.scenes.is_none() {
            return Ok(Some(false));
        }
        let light_monotonic_ns = times.monotonic_ns(light_ns);
        let expected = self.options.expect(times.monotonic_ns(now_ns), light_monotonic_ns)?;
        let (pupil, velocity) = (expected.pupil, expected.velocity.pupil);
        let (period_ns, patient) = (self.options.timing.load().period_ns, self.options.clock.is_none());
        let tracked = self.options.is_tracked();
        let due = Due { now_ns, light_ns, light_monotonic_ns, period_ns, pupil, velocity, tracked, patient };
        let begun = Instant::now();
        let mut taken = self.shared.taken.load();
        self.looked_ns = 0;
        let Some(scenes) = &mut self.options.scenes else { return Ok(Some(false)) };
        let scene = match scenes.next(&due)? {
            Newest::New(scene) => scene,
            Newest::Same => {
                self.supply = FrameFreshness::Same;
                return Ok(Some(false));
            }
            Newest::Late(supply) => {
                self.supply = supply;
                return Ok(Some(false));
            }
            Newest::Refused(reason) => {
                taken.refused += 1;
                self.shared.taken.store(taken);
                if self.told.as_ref() != Some(&reason) {
                    self.options.notes.send(format!("{reason}, and the previous content stays"));
                    self.told = Some(reason);
                }
                return Ok(Some(false));
            }
            Newest::Ended => {
                self.sender.end();
                return Ok(None);
            }
        };
        if !steered {
            // The scene's own hologram is shown, so there is no loss to compare.
            self.refiner.forget_aim();
        }
        if let Some(journal) = &self.options.journal {
            journal.scene(&scene, !steered);
        }
        self.options.moments.follow(&scene.colors, scene.shows_ns.or(scene.arrived_ns).unwrap_or(light_ns));
        let followed = match scene.piece {
            Some(piece) => self.refiner.move_to(piece, &scene.colors)?,
            None => self.refiner.follow(&scene.colors)?,
        };
        if followed.own > 0 {
            self.options.moments.begun_again();
        }
        taken.scenes += 1;
        taken.own_starts += u64::from(followed.own);
        taken.kept_starts += u64::from(followed.kept);
        self.shared.taken.store(taken);
        self.looked_ns = self.options.cost.round_ns(followed.looks as usize, || Duration::ZERO);
        self.options.track.span("scene", scene.number, begun);
        self.building = begun.elapsed();
        (self.scene, self.supply) = (Some(scene), FrameFreshness::New);
        Ok(Some(true))
    }

    fn show_whole(&mut self, target: &Target, now_ns: i64) -> Result<(), SessionError> {
        self.refiner.show_whole()?;
        self.options.journal.iter().for_each(|journal| journal.keep(Decision::Whole {}));
        let mut time = WorkTime::begin(self.options.cost, now_ns);
        let timestamps = Timestamps {
            refine_start_ns: now_ns,
            aimed_ns: now_ns,
            refine_end_ns: now_ns,
            predicted_light_ns: self.light_ns(target),
            ..Timestamps::default()
        };
        self.hand_over(timestamps, None, 0, &mut time)?;
        self.made_ns = time.now_ns();
        Ok(())
    }

    /// Takes steps until the set has to be handed over, and hands it over.
    fn refine_for(&mut self, target: Target, now_ns: i64) -> Result<(), SessionError> {
        let (light_ns, times) = (self.light_ns(&target), Times(self.options.clock));
        let mut time = WorkTime::begin(self.options.cost, now_ns);
        let begun = Instant::now();
        let before = self.refiner.counts();
        let deadline_ns = target.hand_over_ns.saturating_sub(self.ends_ns());
        let mut steps = 0;
        self.sender.does(RepeatReason::StepTooLong);
        // Each round updates the predicted pupil and the scene, because samples and scenes arrive during refinement.
        let (expected, aimed_ns, moves) = loop {
            let at_ns = time.now_ns();
            let expected = self.options.expect(times.monotonic_ns(at_ns), times.monotonic_ns(light_ns))?;
            if self.refiner.aim(expected.pupil)? {
                self.options.moments.begun_again();
            }
            let turn = usize::try_from(target.turn).unwrap_or(0);
            let moves = Moves { motion: self.options.moments.motion(light_ns, &expected), turn };
            self.refiner.moves(&moves.motion, self.options.moments.times(turn))?;
            time.looked(self.shift_phases(light_ns, &expected.pupil, &moves)?);
            self.fit(&expected.pupil, &moves)?;
            let taken = self.refiner.round_while(|steps, expected| time.steps_before(deadline_ns, steps, expected))?;
            steps += taken;
            self.options.journal.iter().for_each(|journal| journal.steps(&expected.pupil, &moves, taken));
            let left_ns = deadline_ns.saturating_sub(time.now_ns()).saturating_sub(self.round_ns());
            let moves = !moves.motion.is_still();
            if taken == 0 || left_ns < 0 {
                break (expected, at_ns, moves);
            }
            // The time to prepare a scene differs between machines, so simulated time leaves it out.
            let building = self.options.clock.map_or(Duration::ZERO, |_| self.building);
            if left_ns > as_ns(building) {
                if self.look_for_scene(&target, time.now_ns(), true)?.is_none() {
                    break (expected, at_ns, moves);
                }
                self.sender.does(RepeatReason::StepTooLong);
            }
        };
        self.refiner.settle()?;
        self.options.track.span("refine", self.number, begun);
        let after = self.refiner.counts();
        self.shared.restarts.fetch_add(after[0] - before[0], Ordering::Relaxed);
        self.shared.steps.fetch_add(u64::from(steps), Ordering::Relaxed);
        if steps == 0 {
            // The time was too short for a step, so the next attempt is for the set after this one.
            if self.options.clock.is_some() {
                std::thread::sleep(SLACK);
            }
            self.made_ns = time.now_ns();
            return Ok(());
        }
        self.shared.moving.fetch_add(u64::from(moves), Ordering::Relaxed);
        let [sample_ns, decoded_ns, filtered_ns] =
            [0, 1, 2].map(|i| expected.sample_ns.map(|s| times.at_monotonic_ns(s[i])));
        let timestamps = Timestamps {
            sample_ns,
            decoded_ns,
            filtered_ns,
            refine_start_ns: now_ns,
            aimed_ns,
            refine_end_ns: time.now_ns(),
            handed_over_ns: 0,
            predicted_light_ns: light_ns,
        };
        let aim = self.options.is_tracked().then_some(expected.pupil);
        self.hand_over(timestamps, aim, steps, &mut time)?;
        self.made_ns = time.now_ns();
        Ok(())
    }
}
