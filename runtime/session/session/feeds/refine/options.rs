//! Defines the options of a refinement.

use crate::gpu::{Gpu, PixelOrder};
use crate::optics::PupilDistribution;
use crate::present::RealClock;
use crate::session::content::scenes::Scenes;
use crate::session::feeds::journal::Journal;
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::notes::Notes;
use crate::session::frame_log::trace::Track;
use crate::session::refinement::agreement::Member;
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

/// Opens the engines with all of their data, and returns the device that they share, if there is one.
pub(crate) type Begin = Box<dyn FnMut() -> Result<(LiveRefiner, Option<Gpu>), SessionError> + Send>;

pub(crate) struct RefinementOptions {
    /// The clock of the player. It is `None` if time is simulated, and work then takes the time that `cost` gives.
    pub clock: Option<RealClock>,
    /// The time that work takes.
    pub cost: Cost,
    /// The source of predicted pupils.
    pub watch: PupilSource,
    /// The scenes, if the content changes.
    pub scenes: Option<Box<dyn Scenes>>,
    /// The journal of decisions, if it is kept.
    pub journal: Option<Journal>,
    /// The timing of the sets on the display, which the present thread updates.
    pub timing: Arc<AtomicCell<SetTiming>>,
    /// The time from the beginning of a set to the middle of its light.
    pub light_after: Duration,
    /// The motion during the light of a set.
    pub moments: MotionCompensation,
    /// True if the hologram follows the pupil. If it is false, the hologram for the whole eyebox is shown.
    pub steered: Arc<AtomicBool>,
    /// The pupils to refine for if no scene brings a hologram for the whole eyebox.
    pub whole: Option<PupilDistribution>,
    /// The order of colors of a display that shows from the device of the engines, to which video frames go directly.
    pub direct: Option<PixelOrder>,
    /// True if sets carry their phases for a preview.
    pub with_phases: bool,
    /// The function that opens the engines again after a loss, with all of their data.
    pub again: Begin,
    /// The place of this eye in an agreement with the other eye, if both show together.
    pub pair: Option<Member>,
    /// The sink for notes about failures.
    pub notes: Notes,
    /// The track of the thread in a trace.
    pub track: Track,
}

impl RefinementOptions {
    /// Returns the pupil to refine for, which is the predicted pupil or the whole eyebox.
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
