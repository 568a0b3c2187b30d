//! Passes whole refined sets through a mailbox. The newest set wins, no side waits, and buffers are reused.

use crate::encode::VideoFrames;
use crate::gpu::Pictures;
use crate::mailbox::Mailbox;
use crate::session::content::scenes::FrameFreshness;
use crate::session::frame_log::account::RepeatReason;
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::latency::Timestamps;
use crate::session::playback::player::SetSource;
use crate::session::playback::scheduler::Target;
use crate::session::playback::scheduler::{Content, Readiness};
use crate::solve::{Motion, Problem};
use crossbeam_utils::atomic::AtomicCell;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// A refined set of video frames.
pub struct FinishedSet {
    /// The number of the set, from 0.
    pub number: u64,
    pub(crate) buffer: SetBuffer,
    /// The times of the events of the set.
    pub timestamps: Timestamps,
    /// The predicted position of the pupil at its light (m).
    pub pupil: [f64; 2],
    /// The depth that the eye is expected to focus at then (m), in the middle of its range. It is `None` for the
    /// hologram for the whole eyebox.
    pub focus: Option<f64>,
    /// The steps that were taken for it, over all colors.
    pub steps: u32,
    /// The number of the scene that it shows, if scenes follow each other.
    pub content: Option<u64>,
    /// The moment of its content, which the sets of both eyes share if they show together.
    pub moment: Option<i64>,
    /// The arrival of the scene (ns on the clock of the player).
    pub arrived_ns: Option<i64>,
    /// The freshness of the scene.
    pub supply: FrameFreshness,
    /// The estimated PSNR through the pupils of its last steps (dB), computed from their losses.
    pub estimated_db: Option<f64>,
    /// The phases for each color, if a preview needs them.
    pub phases: Option<Vec<Arc<Vec<f32>>>>,
    /// The target scene with its exposures, if a preview needs it and the content changes.
    pub scene: Option<(Arc<Vec<Problem>>, Vec<f64>)>,
    /// The motion during its light, for each color.
    pub motion: Vec<Motion>,
}

impl FinishedSet {
    /// Returns the indices of the switchable sources of the display that light the set, for each color and from 0.
    pub fn sources(&self) -> &[Vec<usize>] {
        &self.buffer.sources
    }

    /// Returns true if this set and a set of the other eye are for the same time and the same content. Holograms for
    /// the whole eyebox are for any time.
    pub(crate) fn belongs_to(&self, other: &Self, period_ns: i64) -> bool {
        let apart_ns = self.timestamps.predicted_light_ns.abs_diff(other.timestamps.predicted_light_ns);
        let same_time = match (self.steps, other.steps) {
            (0, 0) => true,
            (0, _) | (_, 0) => false,
            _ => apart_ns <= period_ns.unsigned_abs() / 2,
        };
        same_time && self.moment.zip(other.moment).is_none_or(|(own, others)| own == others)
    }
}

/// A buffer for the video frames of a set, on the host, and for a swapchain also on its device. It also holds the list
/// of sources that light the set. Buffers are reused, so that no set allocates its own.
pub(crate) struct SetBuffer {
    pub frames: VideoFrames,
    pub pictures: Option<Pictures>,
    /// The indices of the sources of each color, from 0.
    pub sources: Vec<Vec<usize>>,
}

impl SetBuffer {
    /// Stores the sources that light the set, for each color, in the existing lists.
    pub(crate) fn lit_by<'a>(&mut self, colors: impl Iterator<Item = &'a [usize]>) {
        let mut count = 0;
        for lit in colors {
            if self.sources.len() == count {
                self.sources.push(Vec::new());
            }
            self.sources[count].clear();
            self.sources[count].extend_from_slice(lit);
            count += 1;
        }
        self.sources.truncate(count);
    }
}

/// The number of buffers. One is on the screen, one is ready, one is in transfer and one is being filled.
const BUFFERS: usize = 4;

/// The side that makes sets.
pub(crate) struct SetSender {
    newest: Mailbox<FinishedSet>,
    free: Mailbox<SetBuffer>,
    over: Arc<AtomicBool>,
    /// The current activity, which is the reason if there is no new set now.
    doing: Arc<AtomicCell<RepeatReason>>,
}

/// The side that shows sets. The newest set is always the one that is due, so no set is ever late. If no new set
/// arrived, the set on the screen is shown again.
pub(crate) struct LiveSource {
    newest: Mailbox<FinishedSet>,
    free: Mailbox<SetBuffer>,
    /// The newest sets that wait to be shown, and their largest number.
    fresh: VecDeque<FinishedSet>,
    keeps: usize,
    pub(crate) on_screen: Option<FinishedSet>,
    changed: bool,
    /// The time of the last poll of a player, at which it decided on a set.
    pub(crate) asked: Option<Instant>,
    /// The repeated sets by reason, in the order of [`RepeatReason::ALL`]. The next field is the reason of the last
    /// decision, if it was a repeat.
    pub(crate) repeats: [u64; 7],
    pub(crate) repeated: Option<RepeatReason>,
    /// The sets that were new when they were decided on.
    pub(crate) news: u64,
    over: Arc<AtomicBool>,
    doing: Arc<AtomicCell<RepeatReason>>,
    /// The maker of sets in simulated time.
    pub(crate) make: Option<Box<dyn SetMaker>>,
}

/// Makes sets when they are requested, in simulated time.
pub(crate) trait SetMaker {
    /// Returns true if the set that begins with the video frame of a target can be ready by then.
    fn can_make(&mut self, target: Target) -> bool;

    /// Makes the set that begins with the video frame of a target, if it can be ready by then.
    fn make(&mut self, target: Target) -> Result<(), SessionError>;
}

/// Creates both sides, with buffers like `frames`, and pictures on a device if `pictures` makes them. At most `keeps`
/// sets wait to be shown.
pub(crate) fn set_channel<E>(
    frames: &VideoFrames,
    keeps: usize,
    mut pictures: impl FnMut() -> Result<Option<Pictures>, E>,
) -> Result<(SetSender, LiveSource), E> {
    // A set may wait in the mailbox and another one with the source.
    let buffers = BUFFERS + 2 * (keeps - 1);
    let (newest, free) = (Mailbox::new(keeps), Mailbox::new(buffers));
    for _ in 0..buffers {
        let _ = free.put(SetBuffer { frames: frames.clone(), pictures: pictures()?, sources: Vec::new() });
    }
    let over = Arc::new(AtomicBool::new(false));
    let doing = Arc::new(AtomicCell::new(RepeatReason::default()));
    let sender =
        SetSender { newest: newest.clone(), free: free.clone(), over: Arc::clone(&over), doing: Arc::clone(&doing) };
    let (fresh, on_screen, asked, make) = (VecDeque::with_capacity(keeps + 1), None, None, None);
    let (changed, repeats, repeated, news) = (false, [0; 7], None, 0);
    let source = LiveSource {
        newest,
        free,
        fresh,
        keeps,
        on_screen,
        changed,
        asked,
        repeats,
        repeated,
        news,
        over,
        doing,
        make,
    };
    Ok((sender, source))
}

fn give_back(free: &Mailbox<SetBuffer>, old: Option<FinishedSet>) {
    if let Some(old) = old {
        let _ = free.put(old.buffer);
    }
}

impl SetSender {
    /// Returns a buffer to fill. One is always free, because at most one set waits, unless a swapchain still reads them
    /// all.
    pub(crate) fn buffer(&self) -> Option<SetBuffer> {
        for _ in 0..self.free.capacity() {
            let buffer = self.free.take()?;
            if !buffer.pictures.as_ref().is_some_and(Pictures::in_use) {
                return Some(buffer);
            }
            let _ = self.free.put(buffer);
        }
        None
    }

    /// Returns a buffer that holds nothing to show.
    pub(crate) fn give_back(&self, buffer: SetBuffer) {
        let _ = self.free.put(buffer);
    }

    pub(crate) fn does(&self, doing: RepeatReason) {
        self.doing.store(doing);
    }

    /// States that no more sets follow.
    pub(crate) fn end(&self) {
        self.over.store(true, Ordering::Release);
    }

    /// Hands over a set. A waiting set that was never shown makes room for it.
    pub(crate) fn send(&self, set: FinishedSet) {
        give_back(&self.free, self.newest.push(set));
    }
}

impl Drop for SetSender {
    fn drop(&mut self) {
        self.does(RepeatReason::RefinementEnded);
    }
}

impl LiveSource {
    /// Returns the set on the screen if it is new since the last call.
    pub(crate) fn newly_shown(&mut self) -> Option<&FinishedSet> {
        std::mem::take(&mut self.changed).then_some(self.on_screen.as_ref()).flatten()
    }

    /// Returns the sets that wait to be shown, the oldest first.
    pub(crate) fn fresh(&self) -> &VecDeque<FinishedSet> {
        &self.fresh
    }

    /// Shows one of the waiting sets. Older ones are never shown.
    pub(crate) fn show_waiting(&mut self, at: usize) {
        for older in self.fresh.drain(..at) {
            let _ = self.free.put(older.buffer);
        }
        let Some(fresh) = self.fresh.pop_front() else { return };
        self.repeated = None;
        self.news += 1;
        self.changed = true;
        give_back(&self.free, self.on_screen.replace(fresh));
    }

    /// Shows the set on the screen again. A set that waits, waits for the other eye.
    pub(crate) fn show_again(&mut self) {
        let why = if !self.fresh.is_empty() { RepeatReason::OtherEye } else { self.doing.load() };
        self.repeats[why as usize] += 1;
        self.repeated = Some(why);
    }

    /// Returns true if the set of a target can be ready in simulated time, or nobody makes one.
    pub(crate) fn can_make(&mut self, target: Target) -> bool {
        self.is_away() || self.make.as_mut().is_none_or(|maker| maker.can_make(target))
    }

    /// States the reason why no set is made now.
    pub(crate) fn waits(&self, why: RepeatReason) {
        self.doing.store(why);
    }

    /// Returns true while no sets can be made, because the engine is lost or refinement has ended.
    pub(crate) fn is_away(&self) -> bool {
        matches!(self.doing.load(), RepeatReason::EngineLost | RepeatReason::RefinementEnded)
            || self.over.load(Ordering::Acquire)
    }
}

/// Returns true if no more sets follow and none waits. The end is read first, so that a set that was handed over before
/// the end is still found.
fn is_over(ended: impl FnOnce() -> bool, none_waits: impl FnOnce() -> bool) -> bool {
    ended() && none_waits()
}

impl Content for LiveSource {
    fn readiness(&self, _position: u64) -> Readiness {
        if !self.fresh.is_empty() || self.on_screen.is_some() { Readiness::Ready } else { Readiness::Unread }
    }

    fn end(&self) -> Option<u64> {
        let over = || self.over.load(Ordering::Acquire);
        is_over(over, || self.fresh.is_empty() && self.newest.is_empty()).then_some(0)
    }
}

impl SetSource for LiveSource {
    fn poll(&mut self, _useful_from: u64) -> Result<(), SessionError> {
        self.asked = Some(Instant::now());
        while let Some(set) = self.newest.take() {
            self.fresh.push_back(set);
            if self.fresh.len() > self.keeps {
                give_back(&self.free, self.fresh.pop_front());
            }
        }
        Ok(())
    }

    fn settle(&mut self, _position: u64, target: Target) -> Result<(), SessionError> {
        if let Some(maker) = &mut self.make {
            maker.make(target)?;
        }
        self.poll(0)
    }

    fn show(&mut self, _position: u64) {
        match self.fresh.len().checked_sub(1) {
            Some(newest) => self.show_waiting(newest),
            None => self.show_again(),
        }
    }

    fn on_screen(&self) -> Option<(&VideoFrames, u64)> {
        self.on_screen.as_ref().map(|set| (&set.buffer.frames, set.number))
    }

    fn pictures(&self) -> Option<&Pictures> {
        self.on_screen.as_ref()?.buffer.pictures.as_ref()
    }

    fn seek(&mut self, _index: u64) {}
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    /// A set that is handed over before the end is shown before it, regardless of the events between two reads.
    #[test]
    fn a_set_handed_over_between_two_reads_is_not_lost() {
        // These are the numbers of reads before the set is handed over, and before the end is stated.
        for (before_set, before_end) in (0..4).flat_map(|set| (set..4).map(move |end| (set, end))) {
            let (reads, waits, over) = (Cell::new(0), Cell::new(false), Cell::new(false));
            let read = |value: &dyn Fn() -> bool| {
                waits.set(waits.get() || reads.get() >= before_set);
                over.set(over.get() || reads.get() >= before_end);
                let found = value();
                reads.set(reads.get() + 1);
                found
            };
            let ended = is_over(|| read(&|| over.get()), || read(&|| !waits.get()));
            assert!(!ended, "the set after {before_set} reads, the end after {before_end}");
        }
        assert!(is_over(|| true, || true));
    }
}
