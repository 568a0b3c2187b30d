//! Runs content whose video frames the calling program takes, one at each of its ticks.
//!
//! This is for programs that have a display, a loop and a clock of their own.

use crate::session::frame_log::error::SessionError;
use crate::session::handle::Session;
use crate::session::options::{About, Content, Ended, SessionOptions, Status};
use crate::session::playback::output::Output;
use crate::session::playback::ticks::{LastTick, TickProducer, TickedFrame, TickedOutput, Ticks};
use crate::steady;
use eyebox_base::reason;
use std::time::Duration;

/// The largest time between now and the light of a tick.
const REACH: Duration = Duration::from_secs(1);
/// The interval at which a tick checks for the end of the session.
const OFTEN: Duration = Duration::from_millis(100);

/// A session whose video frames go to the calling program. Reading, tracking, refinement and encoding run on threads of
/// their own. A tick waits only for the decision on the next video frame.
pub struct TickedSession {
    // This field is dropped before the session. The session waits for its thread when it is dropped, and the thread
    // waits for a tick.
    last: LastTick,
    session: Session,
    ticks: Ticks,
    period: Duration,
    frame: TickedFrame,
}

impl TickedSession {
    /// Starts for a display of `options.display_rate` video frames per second, or 60.
    ///
    /// # Errors
    /// Returns the errors of [`Session::start`], and [`SessionError::Setting`] for options with an observer, because
    /// the ticks replace it.
    pub fn start(content: impl Into<Content>, mut options: SessionOptions) -> Result<Self, SessionError> {
        if options.observer.is_some() {
            return Err(reason!(
                "observer",
                "`observer`: a ticked session has no observer, because its caller takes the video frames"
            )
            .into());
        }
        let ticks = Ticks::new();
        let given = TickProducer(ticks.clone());
        options.observer = Some(Box::new(move |frame| given.put(frame)));
        let session = Session::start(content, Output::Ticked(TickedOutput(ticks.clone())), options)?;
        let period = Duration::from_nanos(session.about().display_rate.period_ns().unsigned_abs());
        Ok(Self { last: LastTick(ticks.clone()), session, ticks, period, frame: TickedFrame::default() })
    }

    /// Returns the next video frame. It lights up at `lit_ns` of the steady clock
    /// ([`trackers::now_ns`](crate::trackers::now_ns)), or a period from now. Returns `None` after the end of the
    /// content.
    ///
    /// # Errors
    /// Returns [`SessionError::Setting`] for a time that is more than a second from now.
    pub fn tick(&mut self, lit_ns: Option<u64>) -> Result<Option<&TickedFrame>, SessionError> {
        let now = steady::now_ns();
        let lit_ns = lit_ns.unwrap_or_else(|| now.saturating_add(self.period.as_nanos() as u64));
        if u128::from(lit_ns.abs_diff(now)) > REACH.as_nanos() {
            let off = (i128::from(lit_ns) - i128::from(now)) as f64 * 1e-9;
            return Err(reason!(
                "lights-up",
                "`lit_ns` is {off:.3} s from now, but it must be within a second on the steady clock"
            )
            .into());
        }
        self.ticks.asks.push(Some(lit_ns));
        let given = loop {
            match self.ticks.frames.take_within(OFTEN) {
                Some(given) => break given,
                None if !self.session.is_running() => break None,
                None => {}
            }
        };
        let Some(frame) = given else {
            // The next tick also ends.
            self.ticks.frames.push(None);
            return Ok(None);
        };
        let before = std::mem::replace(&mut self.frame, frame);
        self.ticks.spare.push(before.picture);
        Ok(Some(&self.frame))
    }

    /// Returns the description of the output and its rates.
    pub fn about(&self) -> &About {
        self.session.about()
    }

    /// Returns the status as of the last tick.
    pub fn status(&self) -> Status {
        self.session.status()
    }

    /// Turns refinement for the tracked pupil on or off.
    pub fn steer(&self, steered: bool) {
        self.session.steer(steered);
    }

    /// Ends the session and returns its result.
    pub fn stop(self) -> Ended {
        let Self { last, session, .. } = self;
        drop(last);
        session.stop()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::{Backend, Choice};
    use crate::gpu::Options;
    use crate::session::stage::{encoder, part};
    use crate::session::{Ending, Live, Tracking};
    use eyebox_base::error::ErrorData;
    use std::collections::{BTreeMap, BTreeSet};
    use std::time::Instant;

    fn live(tracking: Option<Tracking>) -> Live {
        let backend = Backend::open(Choice::Cpu, &Options::default()).unwrap();
        Live::new(vec![part()], encoder(), backend, tracking)
    }

    #[test]
    fn a_program_takes_what_is_refined_for_its_samples() {
        let estimator = crate::gaze::Estimator::new(crate::gaze::Settings::default(), None).unwrap();
        let (eye, tracking) = Tracking::pushed(estimator);
        let mut session = TickedSession::start(live(Some(tracking)), SessionOptions::default()).unwrap();
        let (mut sets, mut numbers, begun) = (BTreeMap::new(), Vec::new(), Instant::now());
        let mut first_light_ns = None;
        while sets.len() < 4 && begun.elapsed() < Duration::from_secs(60) {
            eye.pupil([2e-3, 0.0], Some(4e-3), Duration::ZERO);
            let lit_ns = steady::now_ns() + 40_000_000;
            let frame = session.tick(Some(lit_ns)).unwrap().unwrap();
            assert_eq!(frame.picture.len(), 96 * 112);
            numbers.push(frame.number);
            frame.content.map(|set| sets.insert(set, frame.picture.clone()));
            if frame.content.is_some() {
                first_light_ns.get_or_insert(lit_ns);
            }
            std::thread::sleep(Duration::from_millis(16));
        }
        let pictures: BTreeSet<_> = sets.values().collect();
        assert_eq!((sets.len(), pictures.len()), (4, 4), "each set is another picture");
        assert!(numbers.windows(2).all(|pair| pair[0] < pair[1]), "{numbers:?}");
        assert_eq!(ErrorData::of(&session.tick(Some(0)).unwrap_err()).code, "setting/lights-up");
        let status = session.status();
        assert!(status.live.is_some_and(|live| live.sets_new >= 4 && live.steps >= 4), "{status:?}");
        let ended = session.stop();
        ended.result.unwrap();
        // The first content is lit when the program lights its video frame.
        assert_eq!((status.first_light_ns, ended.statistics.first_light_ns), (first_light_ns, first_light_ns));
        assert_eq!((ended.statistics.ended_by, ended.statistics.timed_by), (Ending::Stopped, "the program"));
        assert!(ended.statistics.report.account.video_frames >= numbers.len() as u64);
    }

    #[test]
    fn it_ends_with_its_content_and_stops_without_a_tick() {
        let options = SessionOptions { duration: Some(Duration::from_millis(100)), ..SessionOptions::default() };
        let mut session = TickedSession::start(live(None), options).unwrap();
        let mut taken = 0;
        while session.tick(None).unwrap().is_some() {
            taken += 1;
            assert!(taken < 10_000, "it does not end");
        }
        assert!(taken > 0 && session.tick(None).unwrap().is_none(), "and stays ended");
        assert_eq!(session.stop().statistics.ended_by, Ending::Duration);
        let never = TickedSession::start(live(None), SessionOptions::default()).unwrap();
        let begun = Instant::now();
        let never = never.stop().statistics;
        assert_eq!((never.ended_by, never.first_light_ns), (Ending::Stopped, None));
        assert!(begun.elapsed() < Duration::from_secs(5));
        // A session that is dropped does not need a tick either.
        drop(TickedSession::start(live(None), SessionOptions::default()).unwrap());
    }
}
