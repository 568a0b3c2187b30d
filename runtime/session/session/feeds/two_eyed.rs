//! Defines the content of two eyes.

use crate::encode::Encoder;
use crate::gpu::Gpu;
use crate::optics::{Panels, Stereo};
use crate::session::feeds::ContentSetup;
use crate::session::feeds::both_eyes::BothEyes;
use crate::session::feeds::live::Live;
use crate::session::feeds::play::Play;
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::notes::Notes;
use crate::session::frame_log::trace::Trace;
use crate::session::playback::output::OpenDisplay;
use crate::session::playback::scheduler::Start;
use crate::session::refinement::agreement::Member;
use eyebox_base::reason;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// The content of the left and the right eye, on one schedule.
///
/// Both eyes have a panel each, and each set of both is shown in the same video frame. The video frames of two monitors
/// go to [`Output::Pair`](crate::session::Output::Pair). Other outputs receive one picture, in which the right eye is
/// below or to the right of the left one.
pub struct TwoEyed {
    pub(crate) eyes: Eyes,
    /// The rule for the sets of the two eyes.
    pub stereo: Stereo,
    /// The places of the two panels.
    pub places: Panels,
}

/// The content of the left and the right eye.
pub(crate) enum Eyes {
    Play([Box<Play>; 2]),
    Live([Box<Live>; 2]),
}

impl TwoEyed {
    /// Plays a sequence for each eye. Both start together and have the settings of the left one.
    pub fn play(left: Play, right: Play, stereo: Stereo, places: Panels) -> Self {
        Self { eyes: Eyes::Play([Box::new(left), Box::new(right)]), stereo, places }
    }

    /// Refines content for each eye. Both have the settings of the left one.
    pub fn live(left: Live, right: Live, stereo: Stereo, places: Panels) -> Self {
        Self { eyes: Eyes::Live([Box::new(left), Box::new(right)]), stereo, places }
    }

    pub(crate) fn encoders(&self) -> [&Encoder; 2] {
        match &self.eyes {
            Eyes::Play(eyes) => eyes.each_ref().map(|eye| &eye.encoder),
            Eyes::Live(eyes) => eyes.each_ref().map(|eye| &eye.encoder),
        }
    }

    /// Checks the settings before anything is opened.
    pub(crate) fn check(&self) -> Result<(), SessionError> {
        let [left, right] = self.encoders();
        let kind = |encoder: &Encoder| {
            let frames = encoder.frames();
            ([frames.count(), frames.height, frames.width, frames.channels], encoder.packed().video_frames)
        };
        let ([a, b], words) =
            ([kind(left), kind(right)], |([count, height, width, channels], _): ([usize; 4], usize)| {
                format!("{count} video frames of {height}x{width}x{channels}")
            });
        if a != b {
            let [left, right] = [words(a), words(b)];
            return Err(reason!(
                "eyes-differ",
                "a set of the left eye has {left} and one of the right eye {right}, but both need the same"
            )
            .into());
        }
        match &self.eyes {
            Eyes::Play(eyes) => {
                if eyes.iter().any(|eye| eye.sequence.newest().is_some()) {
                    return Err(
                        reason!("eyes-replaced", "a hologram that is replaced while it is shown has one eye").into()
                    );
                }
                eyes.iter().try_for_each(|eye| eye.check())
            }
            Eyes::Live(eyes) => {
                if eyes.iter().any(|eye| eye.journal.is_some() || eye.replay.is_some()) {
                    return Err(reason!("eyes-journal", "`journal` and `replay` are for content of one eye").into());
                }
                eyes.iter().try_for_each(|eye| eye.check())
            }
        }
    }

    /// Returns the device that encodes content that is played.
    pub(crate) fn device(&self) -> Option<Gpu> {
        match &self.eyes {
            Eyes::Play([left, _]) => left.device.clone(),
            Eyes::Live(_) => None,
        }
    }

    /// Starts the content of both eyes.
    pub(crate) fn start(
        self,
        display: &mut OpenDisplay,
        steered: &Arc<AtomicBool>,
        notes: &Notes,
        trace: &Trace,
    ) -> Result<ContentSetup<Box<BothEyes>>, SessionError> {
        let Self { eyes, stereo, places } = self;
        let traces = ["left ", "right "].map(|eye| trace.named(eye));
        let [left, right] = match eyes {
            Eyes::Play(eyes) => {
                let [left, right] = eyes.map(|eye| *eye);
                let right = Play { looped: left.looped, rate: left.rate, speed: left.speed, ..right };
                let start = |play: Play, trace: &Trace| play.start(display, notes.clone(), trace.clone());
                [start(left, &traces[0])?, start(right, &traces[1])?]
            }
            Eyes::Live(eyes) => {
                let [left, right] = eyes.map(|eye| *eye);
                let members = match stereo {
                    Stereo::Together => Member::both().map(Some),
                    Stereo::Independent => [None, None],
                };
                let [of_left, of_right] = members;
                // The joined video frames are made on the host.
                let mut start = |live: Live, trace: &Trace, member| {
                    live.start(display, true, Arc::clone(steered), notes, trace.clone(), member)
                };
                [start(left, &traces[0], of_left)?, start(right, &traces[1], of_right)?]
            }
        };
        let ContentSetup { schedule, sub_frames, .. } = right;
        if schedule != left.schedule && !matches!(left.schedule.start, Start::At { .. }) {
            return Err(reason!(
                "eyes-schedules",
                "the eyes have different rates, but both need the same rate, speed and packing"
            )
            .into());
        }
        let (schedule, period_ns) = (left.schedule, schedule.display_rate.period_ns());
        let (eyes, idle) = ([left.running, right.running], [left.idle, right.idle]);
        let both = BothEyes::new(eyes, idle, (stereo, places), period_ns, notes.clone());
        let idle = both.idle();
        Ok(ContentSetup { running: Box::new(both), schedule, idle, sub_frames })
    }
}
