//! Refined sets handed over whole: the newest wins, nobody waits, and the buffers go round.

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
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// A refined set of video frames.
pub struct FinishedSet {
    /// Its number, from 0.
    pub number: u64,
    pub(crate) buffer: SetBuffer,
    /// When what happened to it.
    pub timestamps: Timestamps,
    /// Where the pupil is expected at its light, metres.
    pub pupil: [f64; 2],
    /// Depth that the eye is expected to focus at then, metres, the middle of where it may be; none of the hologram for the
    /// whole eyebox.
    pub focus: Option<f64>,
    /// Steps that were taken for it, over all colours.
    pub steps: u32,
    /// The number of the scene that it shows, where scenes follow each other,
    pub content: Option<u64>,
    /// when that came, on the player's clock,
    pub arrived_ns: Option<i64>,
    /// and whether it is as new as it should be.
    pub supply: FrameFreshness,
    /// What the pupils of its last steps saw, dB, by their losses: an estimate.
    pub estimated_db: Option<f64>,
    /// Its phases, colour by colour, where somebody looks at them too;
    pub phases: Option<Vec<Arc<Vec<f32>>>>,
    /// then, too, what they should show, with its exposures, where that changes.
    pub scene: Option<(Arc<Vec<Problem>>, Vec<f64>)>,
    /// and what moves while it is lit, colour by colour.
    pub motion: Vec<Motion>,
}

impl FinishedSet {
    /// The display's switchable sources that it was made for and is lit by, colour by colour, by their places from 0.
    pub fn sources(&self) -> &[Vec<usize>] {
        &self.buffer.sources
    }
}

/// Room for the video frames of a set: on the host, and, where they go straight to a swapchain, on its device; and for the list
/// of the sources that light it. Buffers go round, so that no set makes its own.
pub(crate) struct SetBuffer {
    pub frames: VideoFrames,
    pub pictures: Option<Pictures>,
    /// Of each colour, by their places from 0.
    pub sources: Vec<Vec<usize>>,
}

impl SetBuffer {
    /// Keeps which sources light the set, colour by colour, in the lists that it has.
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

/// Buffers: one on the screen, one ready, one on its way, one being filled.
const BUFFERS: usize = 4;

/// The side that makes sets.
pub(crate) struct SetSender {
    newest: Mailbox<FinishedSet>,
    free: Mailbox<SetBuffer>,
    over: Arc<AtomicBool>,
    /// What it is doing: why there would be no new set now.
    doing: Arc<AtomicCell<RepeatReason>>,
}

/// The side that shows them. What is due is always the newest set there is, so nothing is ever late; a set for which
/// nothing new came is shown again.
pub(crate) struct LiveSource {
    newest: Mailbox<FinishedSet>,
    free: Mailbox<SetBuffer>,
    fresh: Option<FinishedSet>,
    pub(crate) on_screen: Option<FinishedSet>,
    changed: bool,
    /// When a player last asked what there is: when it decided.
    pub(crate) asked: Option<Instant>,
    /// Sets that were shown again, by their cause, in the order of [`RepeatReason::ALL`], and why the last decision did, if it did.
    pub(crate) repeats: [u64; 6],
    pub(crate) repeated: Option<RepeatReason>,
    /// Sets that were new when they were decided on.
    pub(crate) news: u64,
    over: Arc<AtomicBool>,
    doing: Arc<AtomicCell<RepeatReason>>,
    /// Makes the set that begins at a time, where time is simulated.
    pub(crate) make: Option<SetMaker>,
}

/// Makes the set that such a video frame begins with, if it can be made by then.
pub(crate) type SetMaker = Box<dyn FnMut(Target) -> Result<(), SessionError>>;

/// Both sides, with buffers like `frames`, and pictures on a device where `pictures` makes them.
pub(crate) fn set_channel<E>(
    frames: &VideoFrames,
    mut pictures: impl FnMut() -> Result<Option<Pictures>, E>,
) -> Result<(SetSender, LiveSource), E> {
    let (newest, free) = (Mailbox::new(1), Mailbox::new(BUFFERS));
    for _ in 0..BUFFERS {
        let _ = free.put(SetBuffer { frames: frames.clone(), pictures: pictures()?, sources: Vec::new() });
    }
    let over = Arc::new(AtomicBool::new(false));
    let doing = Arc::new(AtomicCell::new(RepeatReason::default()));
    let sender =
        SetSender { newest: newest.clone(), free: free.clone(), over: Arc::clone(&over), doing: Arc::clone(&doing) };
    let (fresh, on_screen, asked, make) = (None, None, None, None);
    let (changed, repeats, repeated, news) = (false, [0; 6], None, 0);
    let source =
        LiveSource { newest, free, fresh, on_screen, changed, asked, repeats, repeated, news, over, doing, make };
    Ok((sender, source))
}

fn give_back(free: &Mailbox<SetBuffer>, old: Option<FinishedSet>) {
    if let Some(old) = old {
        let _ = free.put(old.buffer);
    }
}

impl SetSender {
    /// A buffer to fill. There is always one (of those that are handed over, one waits at most), unless a swapchain still
    /// reads them all.
    pub(crate) fn buffer(&self) -> Option<SetBuffer> {
        for _ in 0..BUFFERS {
            let buffer = self.free.take()?;
            if !buffer.pictures.as_ref().is_some_and(Pictures::in_use) {
                return Some(buffer);
            }
            let _ = self.free.put(buffer);
        }
        None
    }

    /// Gives back a buffer in which nothing came to be shown.
    pub(crate) fn give_back(&self, buffer: SetBuffer) {
        let _ = self.free.put(buffer);
    }

    pub(crate) fn does(&self, doing: RepeatReason) {
        self.doing.store(doing);
    }

    /// There will be no more sets than are handed over.
    pub(crate) fn end(&self) {
        self.over.store(true, Ordering::Release);
    }

    /// Hands a set over; one that waits still, and was never shown, makes room.
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
    /// The set on the screen, if it was not there when this was last asked.
    pub(crate) fn newly_shown(&mut self) -> Option<&FinishedSet> {
        std::mem::take(&mut self.changed).then_some(self.on_screen.as_ref()).flatten()
    }
}

/// Whether there will be no more sets and none waits. The end is read first: a set that was handed over before it is then
/// seen to wait.
fn is_over(ended: impl FnOnce() -> bool, none_waits: impl FnOnce() -> bool) -> bool {
    ended() && none_waits()
}

impl Content for LiveSource {
    fn readiness(&self, _position: u64) -> Readiness {
        if self.fresh.is_some() || self.on_screen.is_some() { Readiness::Ready } else { Readiness::Unread }
    }

    fn end(&self) -> Option<u64> {
        let over = || self.over.load(Ordering::Acquire);
        is_over(over, || self.fresh.is_none() && self.newest.is_empty()).then_some(0)
    }
}

impl SetSource for LiveSource {
    fn poll(&mut self, _useful_from: u64) -> Result<(), SessionError> {
        self.asked = Some(Instant::now());
        if let Some(set) = self.newest.take() {
            give_back(&self.free, self.fresh.replace(set));
        }
        Ok(())
    }

    fn settle(&mut self, _position: u64, target: Target) -> Result<(), SessionError> {
        if let Some(make) = &mut self.make {
            make(target)?;
        }
        self.poll(0)
    }

    fn show(&mut self, _position: u64) {
        let Some(fresh) = self.fresh.take() else {
            let why = self.doing.load();
            self.repeats[why as usize] += 1;
            self.repeated = Some(why);
            return;
        };
        self.repeated = None;
        self.news += 1;
        self.changed = true;
        give_back(&self.free, self.on_screen.replace(fresh));
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

    /// Whatever happens between two reads: a set that is handed over before the end is shown before it.
    #[test]
    fn a_set_handed_over_between_two_reads_is_not_lost() {
        // Reads before the set is handed over, and before the end is said.
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
