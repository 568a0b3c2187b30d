//! Tests the handover of sets, restarts, and ten minutes of a refinement that is often late.

use crate::encode::VideoFrames;
use crate::optics::PupilDistribution;
use crate::present::{Clock, Offscreen, Rate, SimulatedClock};
use crate::session::feeds::sets::{LiveSource, SetSender, set_channel};
use crate::session::frame_log::trace::Trace;
use crate::session::playback::player::{Player, SetSource};
use crate::session::playback::scheduler::{Content, Readiness, Schedule, Scheduler, Start};
use crate::session::stage::*;
use crate::session::*;
use crate::solve::SplitMix;
use crossbeam_utils::atomic::AtomicCell;
use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

/// Returns an aim at this horizontal position (m).
pub(super) fn aim(x: f64) -> PupilDistribution {
    let diameter = [3.8e-3, 4.2e-3];
    PupilDistribution { centre: [x, 0.0], spread: 1e-4, diameter, focus: [0.0, 0.0], elsewhere: 0.0 }
}

#[test]
fn a_jump_begins_again_and_a_drift_does_not() {
    let whole = part();
    let refiner = |restart| {
        let policy = Policy { restart, ..Policy::default() };
        let mut refiner = LiveRefiner::new(vec![whole.clone(), whole.clone()], policy, cpu).unwrap();
        assert!(!refiner.aim(aim(0.0)).unwrap(), "the first aim is no jump");
        assert_eq!(refiner.round_while(|_, _| true).unwrap(), 2, "one step of each colour");
        refiner
    };
    let mut restarts = refiner(0.5);
    assert!(restarts.phases().unwrap().iter().all(|p| **p != whole.phases));
    assert!(!restarts.aim(aim(1.9e-3)).unwrap(), "less than half a diameter");
    assert!(!restarts.aim(aim(3.8e-3)).unwrap(), "a pursuit is no jump, however far it goes");
    assert!(restarts.phases().unwrap().iter().all(|p| **p != whole.phases));
    assert!(restarts.aim(aim(-1e-3)).unwrap());
    assert!(restarts.phases().unwrap().iter().all(|p| **p == whole.phases));
    assert_eq!(restarts.counts(), [1, 2]);
    let mut never = refiner(f64::INFINITY);
    assert!(!never.aim(aim(9e-3)).unwrap());
    assert!(never.phases().unwrap().iter().all(|p| **p != whole.phases));
}

#[test]
fn no_step_is_begun_that_would_end_too_late() {
    let mut refiner = LiveRefiner::new(vec![part()], Policy::default(), cpu).unwrap();
    refiner.aim(aim(0.0)).unwrap();
    refiner.round_while(|_, _| true).unwrap();
    assert!(refiner.round() > Duration::ZERO);
    assert_eq!(refiner.round_while(|_, expected| expected.is_zero()).unwrap(), 0);
    assert!(LiveRefiner::new(Vec::new(), Policy::default(), cpu).is_err());
    let policy = Policy { restart: f64::NAN, ..Policy::default() };
    assert!(LiveRefiner::new(vec![part()], policy, cpu).is_err());
}

fn channel(frames: &VideoFrames) -> (SetSender, LiveSource) {
    set_channel(frames, 1, || Ok::<_, SessionError>(None)).unwrap()
}

pub(super) fn made(sender: &SetSender, number: u64) -> FinishedSet {
    let mut buffer = sender.buffer().expect("there is always a buffer");
    // Every byte holds the number of its set.
    buffer.frames.bytes_mut().fill((number % 251) as u8);
    FinishedSet {
        number,
        buffer,
        timestamps: Timestamps::default(),
        pupil: [0.0; 2],
        focus: None,
        steps: 1,
        content: None,
        moment: None,
        arrived_ns: None,
        supply: FrameFreshness::Same,
        estimated_db: None,
        phases: None,
        scene: None,
        motion: Vec::new(),
    }
}

/// Sets of two eyes belong together if they are for the same light and the same moment of the content.
#[test]
fn sets_of_the_same_moment_belong_together() {
    let set = |light_ns, moment| {
        let (sender, _source) = channel(&encoder().frames());
        let timestamps = Timestamps { predicted_light_ns: light_ns, ..Timestamps::default() };
        FinishedSet { timestamps, moment, ..made(&sender, 0) }
    };
    let one = set(100, Some(7));
    for (light_ns, moment, belongs) in
        [(100, Some(7), true), (104, Some(7), true), (106, Some(7), false), (100, Some(8), false), (100, None, true)]
    {
        assert_eq!(one.belongs_to(&set(light_ns, moment), 10), belongs, "{light_ns} {moment:?}");
    }
}

#[test]
fn the_newest_set_wins_and_buffers_go_round() {
    let (sender, mut source) = channel(&encoder().frames());
    assert_eq!(source.readiness(0), Readiness::Unread);
    for number in 0..100 {
        sender.send(made(&sender, number));
        if number % 7 == 0 {
            source.poll(0).unwrap();
        }
        if number % 10 == 9 {
            source.poll(0).unwrap();
            source.show(number);
            assert_eq!(source.on_screen().map(|s| s.1), Some(number));
            assert_eq!(source.newly_shown().map(|m| m.number), Some(number));
            assert!(source.newly_shown().is_none(), "told once");
        }
    }
    // Without a new set the last one stays and is counted.
    source.show(1000);
    assert_eq!(
        (source.on_screen().map(|s| s.1), (source.news, source.repeats)),
        (Some(99), (10, [1, 0, 0, 0, 0, 0, 0]))
    );
    for (i, doing) in RepeatReason::ALL.into_iter().enumerate() {
        sender.does(doing);
        source.show(1001);
        assert_eq!((source.repeats[i], source.repeated), (1 + u64::from(i == 0), Some(doing)));
    }
    // The sender is gone, and the picture stays.
    drop(sender);
    source.poll(0).unwrap();
    source.show(1002);
    assert_eq!((source.readiness(7), source.repeated), (Readiness::Ready, Some(RepeatReason::RefinementEnded)));
}

/// A refinement in simulated time. It aims for the next set that it expects to reach, and takes a random time.
struct Simulated {
    clock: Rc<SimulatedClock>,
    sender: SetSender,
    timing: Rc<AtomicCell<SetTiming>>,
    ready_ns: i64,
    number: u64,
    noise: SplitMix,
}

impl Simulated {
    /// Sends the sets that would have been handed over by now.
    fn pass(&mut self) {
        while self.ready_ns <= self.clock.now_ns() {
            self.sender.send(made(&self.sender, self.number));
            self.number += 1;
            let now = self.ready_ns;
            let estimate = 4_000_000;
            let target = self.timing.load().reachable(now, estimate);
            // One in twenty takes ten times its estimate, after all available time was used.
            let late = self.noise.unit() < 0.05;
            let took = target.hand_over_ns.max(now) - now + if late { 10 * estimate } else { 0 };
            self.ready_ns = now + took.max(estimate);
        }
    }
}

/// A source whose sets come from a refinement in the same simulated time.
struct Follows<'a>(&'a mut LiveSource, &'a RefCell<Simulated>);

impl Content for Follows<'_> {
    fn readiness(&self, position: u64) -> Readiness {
        self.0.readiness(position)
    }

    fn end(&self) -> Option<u64> {
        self.0.end()
    }
}

impl SetSource for Follows<'_> {
    fn poll(&mut self, useful_from: u64) -> Result<(), SessionError> {
        self.1.borrow_mut().pass();
        self.0.poll(useful_from)
    }

    fn settle(&mut self, position: u64, target: Target) -> Result<(), SessionError> {
        self.0.settle(position, target)
    }

    fn show(&mut self, position: u64) {
        self.0.show(position);
    }

    fn on_screen(&self) -> Option<(&VideoFrames, u64)> {
        self.0.on_screen()
    }

    fn seek(&mut self, index: u64) {
        self.0.seek(index);
    }
}

#[test]
fn in_ten_minutes_no_set_is_late_because_of_refinement() {
    let clock = Rc::new(SimulatedClock::default());
    let rate = Rate::new(60, 1).unwrap();
    let frames = encoder().frames();
    let (sender, mut source) = channel(&frames);
    let first = SetTiming { lead_ns: 3_000_000, ..SetTiming::new(rate.period_ns()) };
    let timing = Rc::new(AtomicCell::new(first));
    let simulated = RefCell::new(Simulated {
        clock: Rc::clone(&clock),
        sender,
        timing: Rc::clone(&timing),
        ready_ns: 0,
        number: 0,
        noise: SplitMix(9),
    });
    let schedule = Schedule {
        rolls: false,
        display_rate: rate,
        content_rate: rate,
        speed: Speed::new(1.0).unwrap(),
        set_frames: 1,
        start: Start::WhenReady { idle_sets: 4 },
        waits: false,
        keep_phase: false,
    };
    let mut presenter = Offscreen::new(Rc::clone(&clock) as Rc<dyn Clock>, rate, frames.frame_bytes());
    let idle = frames.clone();
    let dyn_clock = Rc::clone(&clock) as Rc<dyn Clock>;
    let mut player = Player::new(dyn_clock, Scheduler::new(schedule), idle, Trace::none().track("present"));
    let (mut last, mut news) = (0, 0u64);
    let ten_minutes = 600 * 1_000_000_000;
    while clock.now_ns() < ten_minutes {
        let asked = clock.now_ns();
        let mut began = None;
        player
            .tick(&mut presenter, &mut Follows(&mut source, &simulated), &mut |moment| {
                began = Some(moment.predicted_display_time_ns);
                if let Some(number) = moment.index {
                    assert!(moment.picture.iter().all(|b| u64::from(*b) == number % 251), "torn at {asked}");
                    assert!(number >= last, "{number} after {last}");
                    news += u64::from(number > last);
                    last = number;
                }
                Ok(())
            })
            .unwrap();
        let decided = clock.now_ns().min(began.unwrap_or(0) - 2_000_000);
        timing.store(timing.load().after(began.unwrap_or(0), decided));
    }
    let account = player.scheduler.account();
    assert_eq!(account.late_sets, [0; 5]);
    assert_eq!((account.drops(), account.missed_presents), (0, 0));
    assert!(account.sets.abs_diff(36_000) <= 2, "{} sets", account.sets);
    // One of twenty takes three periods, and the others are all new.
    let share = news as f64 / account.sets as f64;
    assert!((0.8..0.95).contains(&share), "{share} of the sets were new");
}
