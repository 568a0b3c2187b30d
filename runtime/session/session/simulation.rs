//! Simulates a display and a producer in simulated time, with the faults of real ones.
//!
//! The log holds the actual content of the panel, which tests compare with.

use crate::encode::{Encoder, VideoFrames};
use crate::optics::{Color, Display};
use crate::present::{Clock, Feedback, PresentError, Presenter, Rate, SimulatedClock};
use crate::session::frame_log::trace::Trace;
use crate::session::playback::player::{Flow, Player, SetSource};
use crate::session::playback::scheduler::{Content, Readiness, Schedule, Scheduler};
use crate::session::{SessionError, Target};
use crate::solve::SplitMix;
use std::collections::{BTreeSet, VecDeque};
use std::rc::Rc;

/// The content of the panel from one timing to the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lit {
    pub timing: i64,
    /// The position and the video frame that were painted into the picture, or `None` for the idle picture.
    pub set: Option<u64>,
    pub video_frame: u64,
}

/// A panel with a rate and a phase of its own. A video frame lights up at the next free timing.
pub struct Panel {
    clock: Rc<SimulatedClock>,
    rate: Rate,
    phase_ns: i64,
    /// The timings at which nothing new can light up.
    pub stuck: BTreeSet<i64>,
    /// The largest error of reported times in either direction (ns).
    pub jitter_ns: i64,
    noise: SplitMix,
    picture: [u8; 9],
    next: i64,
    pub log: Vec<Lit>,
    feedback: VecDeque<Feedback>,
}

impl Panel {
    pub fn new(clock: Rc<SimulatedClock>, rate: Rate, phase_ns: i64) -> Self {
        let (stuck, log, feedback) = (BTreeSet::new(), Vec::new(), VecDeque::new());
        Self { clock, rate, phase_ns, stuck, jitter_ns: 0, noise: SplitMix(5), picture: [0; 9], next: 0, log, feedback }
    }

    /// Delays its timing by this much from now on.
    pub fn shift(&mut self, by_ns: i64) {
        self.phase_ns += by_ns;
    }

    pub(crate) fn time_of_ns(&self, timing: i64) -> i64 {
        self.phase_ns + self.rate.time_of_ns(timing)
    }
}

impl Presenter for Panel {
    fn describe(&self) -> String {
        "a simulated panel".into()
    }

    fn upload(&mut self, picture: &[u8]) -> Result<(), PresentError> {
        self.picture.copy_from_slice(&picture[..9]);
        Ok(())
    }

    fn present(&mut self, id: u64, _desired_present_time_ns: i64) -> Result<(), PresentError> {
        while self.time_of_ns(self.next) <= self.clock.now_ns() || self.stuck.contains(&self.next) {
            self.next += 1;
        }
        let word = u64::from_le_bytes(self.picture[..8].try_into().expect("eight bytes"));
        let set = (word > 0).then(|| word - 1);
        self.log.push(Lit { timing: self.next, set, video_frame: u64::from(self.picture[8]) });
        let off = (2.0 * self.noise.unit() - 1.0) * self.jitter_ns as f64;
        let actual_display_time_ns = self.time_of_ns(self.next) + off as i64;
        self.feedback.push_back(Feedback { id, actual_display_time_ns });
        self.next += 1;
        // Two video frames may wait. Then the swapchain is full.
        self.clock.wait_until_ns(self.time_of_ns(self.next - 2));
        Ok(())
    }

    fn feedback(&mut self) -> Option<Feedback> {
        let due = self.feedback.front().is_some_and(|f| f.actual_display_time_ns <= self.clock.now_ns());
        if due { self.feedback.pop_front() } else { None }
    }
}

/// Content that is read and encoded at times that a test gives.
pub struct Producer {
    clock: Rc<SimulatedClock>,
    /// The times at which a position is read, and at which it is encoded.
    pub read_ns: Box<dyn Fn(u64) -> i64>,
    pub encoded_ns: Box<dyn Fn(u64) -> i64>,
    pub damaged: BTreeSet<u64>,
    pub end: Option<u64>,
    screen: VideoFrames,
    on: Option<u64>,
}

impl Content for Producer {
    fn readiness(&self, position: u64) -> Readiness {
        let now = self.clock.now_ns();
        if self.end.is_some_and(|end| position >= end) || (self.read_ns)(position) > now {
            Readiness::Unread
        } else if self.damaged.contains(&position) {
            Readiness::Damaged
        } else if (self.encoded_ns)(position) > now {
            Readiness::Read
        } else {
            Readiness::Ready
        }
    }

    fn end(&self) -> Option<u64> {
        self.end
    }
}

impl SetSource for Producer {
    fn poll(&mut self, _useful_from: u64) -> Result<(), SessionError> {
        Ok(())
    }

    // Late content stays late here, although the clock is simulated.
    fn settle(&mut self, _position: u64, _target: Target) -> Result<(), SessionError> {
        Ok(())
    }

    fn show(&mut self, position: u64) {
        assert_eq!(self.readiness(position), Readiness::Ready);
        paint(&mut self.screen, position + 1);
        self.on = Some(position);
    }

    fn on_screen(&self) -> Option<(&VideoFrames, u64)> {
        self.on.map(|index| (&self.screen, index))
    }

    fn seek(&mut self, _index: u64) {}
}

fn paint(frames: &mut VideoFrames, word: u64) {
    let each = frames.frame_bytes();
    for (video_frame, picture) in frames.bytes_mut().chunks_exact_mut(each).enumerate() {
        picture[..8].copy_from_slice(&word.to_le_bytes());
        picture[8] = video_frame as u8;
    }
}

/// Creates sets of `count` video frames, each large enough for a number.
fn frames(count: u64) -> VideoFrames {
    let display = Display { height: 4, width: 4, ..Display::preset("grey8").expect("a preset") };
    let mut frames = Encoder::new(&display, &[Color::Green], count as usize).expect("an encoder").frames();
    paint(&mut frames, 0);
    frames
}

/// A player connected to a panel.
pub struct Simulation {
    pub clock: Rc<SimulatedClock>,
    pub panel: Panel,
    pub producer: Producer,
    pub player: Player,
}

impl Simulation {
    /// Creates a simulation. `panel_rate` is the true rate of the panel, and the schedule has the rate that the player
    /// assumes.
    pub fn new(schedule: Schedule, panel_rate: Rate) -> Self {
        let clock = Rc::new(SimulatedClock::default());
        let panel = Panel::new(Rc::clone(&clock), panel_rate, 7_654_321);
        let producer = Producer {
            clock: Rc::clone(&clock),
            read_ns: Box::new(|_| 0),
            encoded_ns: Box::new(|_| 0),
            damaged: BTreeSet::new(),
            end: None,
            screen: frames(schedule.set_frames),
            on: None,
        };
        let idle = frames(schedule.set_frames);
        let player = Player::new(
            Rc::<SimulatedClock>::clone(&clock) as Rc<dyn Clock>,
            Scheduler::new(schedule),
            idle,
            Trace::none().track(""),
        );
        Self { clock, panel, producer, player }
    }

    /// Advances the clock before the start.
    pub(crate) fn clock_to(&mut self, time_ns: i64) {
        self.clock.wait_until_ns(time_ns);
    }

    /// Plays until a time or the end.
    pub(crate) fn run_until(&mut self, time_ns: i64) -> Flow {
        while self.clock.now_ns() < time_ns {
            let flow = self.player.tick(&mut self.panel, &mut self.producer, &mut |_| Ok(())).expect("no faults");
            if flow != Flow::Continue {
                return flow;
            }
        }
        Flow::Continue
    }

    /// Returns the sets that the panel showed, each with its first timing, including repeats. Fails for a torn or a
    /// mixed set, and for one that is out of order.
    pub fn sets(&self) -> Vec<(Option<u64>, i64)> {
        let n = self.player.scheduler.schedule().set_frames;
        let mut sets = Vec::new();
        let mut log = self.panel.log.clone();
        // These video frames were held so that sets keep their phase.
        log.dedup_by(|b, a| n > 1 && (a.set, a.video_frame) == (b.set, b.video_frame) && a.video_frame == n - 1);
        for set in log.chunks(n as usize) {
            for (i, lit) in set.iter().enumerate() {
                assert_eq!((lit.set, lit.video_frame), (set[0].set, i as u64), "torn at timing {}", lit.timing);
            }
            sets.push((set[0].set, set[0].timing));
        }
        assert!(sets.windows(2).all(|w| w[0].0 <= w[1].0 && w[0].1 < w[1].1), "out of order");
        sets
    }
}
