//! What a refinement is started with.

use crate::gpu::{Gpu, PixelOrder};
use crate::optics::PupilDistribution;
use crate::present::RealClock;
use crate::session::content::scenes::Scenes;
use crate::session::feeds::journal::Journal;
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::notes::Notes;
use crate::session::frame_log::trace::Track;
use crate::session::refinement::live_refiner::LiveRefiner;
use crate::session::refinement::moments::MotionCompensation;
use crate::session::refinement::pupil_source::PupilSource;
use crate::session::refinement::pupil_tracker::PupilEstimate;
use crate::session::refinement::set_timing::SetTiming;
use crate::session::refinement::work_time::Cost;
use crossbeam_utils::atomic::AtomicCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Makes the engines with all that is on them, and says which device they share, if it is one.
pub(crate) type Begin = Box<dyn FnMut() -> Result<(LiveRefiner, Option<Gpu>), SessionError> + Send>;

pub(crate) struct RefinementOptions {
    /// The player's clock; none where time is simulated, and work takes what it is said to take.
    pub clock: Option<RealClock>,
    /// What work takes.
    pub cost: Cost,
    /// Who is asked where the pupil will be.
    pub watch: PupilSource,
    /// What is to be seen, where that changes.
    pub scenes: Option<Box<dyn Scenes>>,
    /// Where decisions are kept.
    pub journal: Option<Journal>,
    /// When the display begins sets; who presents says it.
    pub timing: Arc<AtomicCell<SetTiming>>,
    /// From the beginning of a set to the middle of its light.
    pub light_after: Duration,
    /// What moves while a set is lit.
    pub moments: MotionCompensation,
    /// Whether the hologram follows the eye; if not, the one for the whole eyebox is shown.
    pub steered: Arc<AtomicBool>,
    /// Where no scene brings one: the pupils that are refined for in its place.
    pub whole: Option<PupilDistribution>,
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

impl RefinementOptions {
    /// What is refined for: where the pupil is expected, or all of the eyebox.
    pub(super) fn expect(&mut self, now_ns: u64, light_ns: u64) -> Result<PupilEstimate, SessionError> {
        match self.whole {
            Some(pupil) if !self.steered.load(Ordering::Acquire) => Ok(PupilEstimate::of(pupil)),
            _ => self.watch.expect(now_ns, light_ns),
        }
    }

    pub(super) fn is_tracked(&self) -> bool {
        self.watch.is_tracked() && self.steered.load(Ordering::Acquire)
    }
}
