//! What moves while a set is lit (OPTICS 15): content, by the frames of it that came; the eye, by its tracker.

use crate::encode::{Lighting, LitTimes};
use crate::scene::displacement;
use crate::session::refinement::field::LiveColor;
use crate::session::refinement::pupil_tracker::PupilEstimate;
use crate::solve::{Motion, Problem};

/// Content that moves by less in a set stands still, pixels.
const STILL_BELOW_PX: f64 = 0.5;
/// Two displacements in a row are one motion where they differ by no more than this share of it, and so many pixels a frame.
const SAME_MOTION_RATIO: f64 = 0.5;
const SAME_MOTION_PX: f64 = 1.0;
/// Frames farther apart say nothing of each other, seconds.
const MAX_FRAME_GAP_S: f64 = 0.15;
/// Frames nearer in time than this show one moment: two answers to requests for one light differ by a nanosecond, and one
/// pixel in that would be 16,666,666 pixels per set. Content has 480 frames per second at most.
const ONE_MOMENT: f64 = 2e-3;
/// So many intervals after its last frame content has stopped.
const STOPPED: f64 = 2.5;
/// Views from places farther apart than this show another parallax, metres.
const SAME_PLACE: f64 = 0.25e-3;
/// A velocity is known to differ from another beyond so many standard deviations.
const SURE: f64 = 3.0;
/// A pupil that moves by less in a set rests, metres.
const RESTS: f64 = 2e-5;

/// The view that motion is told by.
struct ReferenceView {
    picture: Vec<f32>,
    size: [usize; 2],
    /// A pixel of it, radians.
    pixel: f64,
    center: [f64; 2],
    shows_ns: i64,
}

/// What moves, as a session knows it. By default nothing does: all sub-frames of a set are taken to be lit at once.
#[derive(Default)]
pub struct MotionCompensation {
    /// When the sub-frames of each colour are lit, and how long a set is, nanoseconds; none where that does not count.
    lit: Option<(Lighting, i64)>,
    seen: Option<ReferenceView>,
    /// Where the content was, radians, when the last displacement ended: at this time, nanoseconds.
    since: Option<([f64; 2], i64)>,
    /// The last displacement, and the time between its frames, seconds; then, if the one before agrees, the velocity, radians a
    /// second.
    displaced: Option<([f64; 2], f64)>,
    velocity: [f64; 2],
    /// Where the content of the last frame stands, since it is one content, radians; and where the phases show it that are lit with
    /// each turn.
    position: [f64; 2],
    carried: Vec<[f64; 2]>,
    /// By how many whole pixels of the first colour these have to be moved.
    shifts: Vec<[i64; 2]>,
    /// Side of a pixel of the first colour, radians.
    pixel: f64,
    /// Phases that were moved with this motion lost less.
    trusted: bool,
}

impl MotionCompensation {
    /// With sub-frames at times of their own, in sets that follow each other after `set_ns`; `pixel` is the first colour's, radians.
    pub fn of(lighting: Lighting, set_ns: i64, pixel: f64) -> Self {
        let (carried, shifts) = (vec![[0.0; 2]; lighting.turns()], vec![[0; 2]; lighting.turns()]);
        Self { lit: Some((lighting, set_ns)), pixel, carried, shifts, ..Self::default() }
    }

    /// Of these colours on a display that lights sub-frames so, where it `counts`.
    pub(crate) fn when(counts: bool, lighting: Lighting, set_ns: i64, colors: &[LiveColor]) -> Self {
        let first = colors.first().filter(|_| counts);
        first.map_or_else(Self::default, |first| Self::of(lighting, set_ns, first.problem.pixel()))
    }

    /// When the sub-frames of each colour are lit from this turn on.
    pub fn times(&self, turn: usize) -> &[LitTimes] {
        self.lit.as_ref().map_or(&[], |(lighting, _)| lighting.times(turn))
    }

    /// What the display lights when, and by how many pixels of the first colour [`find_shifts`](Self::find_shifts) has found that what is lit
    /// with each turn has to be moved.
    pub fn shifts(&self) -> Option<(&[[i64; 2]], &Lighting)> {
        self.lit.as_ref().map(|(lighting, _)| (self.shifts.as_slice(), lighting))
    }

    /// Another content frame, which shows the moment `shows_ns`.
    pub fn follow(&mut self, colors: &[LiveColor], shows_ns: i64) {
        let Some(first) = colors.first().filter(|_| self.lit.is_some()) else { return };
        let new = view_of(&first.problem, shows_ns);
        let before = self.displaced.take();
        let Some(last) = std::mem::replace(&mut self.seen, new) else {
            self.since = Some((self.position, shows_ns));
            return;
        };
        let Some(new) = &self.seen else { return };
        let (from, since_ns) = self.since.unwrap_or((self.position, last.shows_ns));
        let elapsed = new.shows_ns.saturating_sub(since_ns) as f64 * 1e-9;
        let near = (0..2).all(|i| (new.center[i] - last.center[i]).abs() <= SAME_PLACE);
        if !near && elapsed > 0.0 && elapsed <= MAX_FRAME_GAP_S {
            // The eye has moved, and the views with it: the content is taken to go on as it did.
            self.position = [0, 1].map(|i| from[i] + self.velocity[i] * elapsed);
            (self.displaced, self.since) = (before, Some((self.position, new.shows_ns)));
            return;
        }
        let moved = Some(()).filter(|()| elapsed > -ONE_MOMENT && elapsed <= MAX_FRAME_GAP_S && new.size == last.size);
        let moved = moved.and_then(|()| displacement(&last.picture, &new.picture, new.size));
        let moved = moved.map(|pixels| pixels.map(|d| d * new.pixel));
        let Some(moved) = moved else {
            self.cut();
            return;
        };
        // Phases go where the picture went.
        self.position = [0, 1].map(|i| self.position[i] + moved[i]);
        if elapsed < ONE_MOMENT {
            // The same moment again, a little elsewhere. That is no velocity.
            self.displaced = before;
            return;
        }
        let moved = [0, 1].map(|i| self.position[i] - from[i]);
        self.since = Some((self.position, new.shows_ns));
        let speed = |(d, s): ([f64; 2], f64)| d.map(|v| v / s);
        let steady = before.is_some_and(|before| {
            let (was, is) = (speed(before), speed((moved, elapsed)));
            let off = (is[0] - was[0]).hypot(is[1] - was[1]);
            off <= SAME_MOTION_RATIO * is[0].hypot(is[1]) + SAME_MOTION_PX * self.pixel / elapsed
        });
        if steady {
            self.velocity = speed((moved, elapsed));
        } else {
            // A jump, or the beginning of a motion: nothing is foreseen.
            (self.velocity, self.trusted) = ([0.0; 2], false);
        }
        self.displaced = Some((moved, elapsed));
    }

    /// Other content, which begins where it is.
    fn cut(&mut self) {
        (self.displaced, self.velocity, self.trusted) = (None, [0.0; 2], false);
        self.since = self.seen.as_ref().map(|seen| (self.position, seen.shows_ns));
        self.carried.fill(self.position);
    }

    /// The phases are those that were solved for the last frame.
    pub fn begun_again(&mut self) {
        self.carried.fill(self.position);
    }

    /// Whether the content moves by the light at `light_ns`: radians a second, and since when it is where the last frame has it.
    fn content(&self, light_ns: i64) -> Option<([f64; 2], f64)> {
        let (seen, (_, set_ns)) = (self.seen.as_ref()?, self.lit.as_ref()?);
        let (_, interval) = self.displaced?;
        let since = light_ns.saturating_sub(seen.shows_ns) as f64 * 1e-9;
        let a_set = *set_ns as f64 * 1e-9 * self.velocity[0].hypot(self.velocity[1]);
        let moves =
            a_set >= STILL_BELOW_PX * self.pixel && since.abs() <= STOPPED * interval + 2.0 * *set_ns as f64 * 1e-9;
        moves.then_some((self.velocity, since))
    }

    /// Finds by how many whole pixels of the first colour the phases have to be moved to show the content where it is when they
    /// are lit: those whose turn it is at `light_ns`, the others one after the other until it is their turn again. Whether it has to
    /// be looked whether that is better; none where nothing need be moved.
    pub fn find_shifts(&mut self, light_ns: i64, turn: usize) -> Option<bool> {
        let (lighting, set_ns) = self.lit.as_ref()?;
        let turns = lighting.turns();
        let ([vx, vy], since) = self.content(light_ns).unwrap_or_default();
        let from_turn_to_turn = *set_ns as f64 * 1e-9 / turns as f64;
        for i in 0..turns {
            let since = since + ((i + turns - turn % turns) % turns) as f64 * from_turn_to_turn;
            let there = [self.position[0] + vx * since, self.position[1] + vy * since];
            let pixels = [0, 1].map(|axis| ((there[axis] - self.carried[i][axis]) / self.pixel.max(1e-12)).round());
            self.shifts[i] = if pixels.iter().all(|p| p.abs() < 1e6) { pixels.map(|p| p as i64) } else { [0; 2] };
        }
        self.shifts.iter().any(|shift| *shift != [0; 2]).then_some(!self.trusted)
    }

    /// The phases were moved so, or stay as they are for that is better.
    pub fn carried(&mut self, moved: bool) {
        for (carried, shift) in self.carried.iter_mut().zip(&self.shifts) {
            *carried = [0, 1].map(|i| carried[i] + shift[i] as f64 * self.pixel);
        }
        self.trusted = moved && self.velocity != [0.0; 2];
    }

    /// What moves while a set is lit that is reckoned from `light_ns`, for an eye of which this is known: in pixels of the first
    /// colour.
    pub fn motion(&self, light_ns: i64, eye: &PupilEstimate) -> Motion {
        let Some((_, set_ns)) = &self.lit else { return Motion::default() };
        let set = *set_ns as f64 * 1e-9;
        let drift = eye.velocity.pupil.map(|v| v * set);
        let drift = if drift[0].hypot(drift[1]) < RESTS { [0.0; 2] } else { drift };
        let pixel = self.pixel;
        let a_set = |v: [f64; 2]| v.map(|v| v * set / pixel);
        let moving = self.content(light_ns);
        let content = moving.map_or([0.0; 2], |(velocity, _)| a_set(velocity));
        let at = moving.map_or(0.0, |(_, since)| -since / set);
        let turning = eye.velocity.turning.map(|(turning, spread)| (a_set(turning), spread * set / pixel));
        let (eye, spread) = turns(content, turning);
        Motion { content, at, eye, spread, drift, ..Motion::default() }
    }
}

/// How the eye turns, pixels a set, and how surely: it rests, follows the content, or does as the tracker says; none where it may as
/// well rest as follow.
fn turns(content: [f64; 2], turning: Option<([f64; 2], f64)>) -> (Option<[f64; 2]>, f64) {
    let Some((turning, spread)) = turning else { return (None, 0.0) };
    let off = |from: [f64; 2]| (turning[0] - from[0]).hypot(turning[1] - from[1]);
    let [rests, follows] = [[0.0; 2], content].map(|v| off(v) <= SURE * spread);
    match (rests, follows) {
        (true, true) if content == [0.0; 2] => (Some([0.0; 2]), 0.0),
        (true, true) => (None, 0.0),
        (true, false) => (Some([0.0; 2]), 0.0),
        (false, true) => (Some(content), 0.0),
        (false, false) => (Some(turning), spread),
    }
}

/// The middle view, at a size that is soon compared.
fn view_of(problem: &Problem, shows_ns: i64) -> Option<ReferenceView> {
    let pyramid = &problem.pyramid;
    let level = pyramid.levels.get(pyramid.compared()?)?;
    let (pixels, pixel) = (level.height * level.width, problem.pixel());
    let pixel = pixel * pyramid.levels.first()?.width as f64 / level.width as f64;
    let middle = (problem.views.rows / 2 * problem.views.columns + problem.views.columns / 2) * pixels;
    let picture = level.views.get(middle..middle + pixels)?.iter().map(|v| f32::from(*v) * pyramid.scale).collect();
    Some(ReferenceView { picture, size: [level.height, level.width], pixel, center: problem.center, shows_ns })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::Encoder;
    use crate::gaze::EyeVelocity;
    use crate::optics::{Color, Display, Padding, PupilDistribution};
    use crate::session::stage::one_view;

    const SET_NS: i64 = 16_666_667;
    const SIDE: usize = 64;

    /// A picture of blobs that stands `shift` pixels to the right, round its edges.
    fn frame(display: &Display, shift: usize, seed: u64) -> Vec<LiveColor> {
        let mut random = fastrand::Rng::with_seed(seed);
        let blobs: Vec<[f64; 2]> = (0..40).map(|_| [0, 1].map(|_| SIDE as f64 * random.f64())).collect();
        let light = |row: usize, column: usize| {
            let column = (column + SIDE - shift) % SIDE;
            let near = |[x, y]: &[f64; 2]| (-((column as f64 - x).powi(2) + (row as f64 - y).powi(2)) / 8.0).exp();
            blobs.iter().map(near).sum::<f64>() as f32
        };
        let view: Vec<f32> = (0..SIDE * SIDE).map(|i| light(i / SIDE, i % SIDE)).collect();
        let field = one_view(display, view);
        let problem = Problem::new(&field, Color::Green, display, Padding::default()).unwrap();
        vec![LiveColor { problem, phases: Vec::new(), exposure: 0.35, laser: None }]
    }

    fn display() -> Display {
        Display { height: SIDE, width: SIDE, ..Display::preset("planes8").unwrap() }
    }

    fn eye(turning: Option<([f64; 2], f64)>) -> PupilEstimate {
        let whole =
            PupilDistribution { centre: [0.0; 2], spread: 1e-3, diameter: [4e-3; 2], focus: [0.0; 2], elsewhere: 0.0 };
        PupilEstimate { velocity: EyeVelocity { turning, ..EyeVelocity::default() }, ..PupilEstimate::of(whole) }
    }

    /// Content at 30 frames a second on 60 sets, 4 pixels a frame: two pixels a set from the third frame on, extrapolated between
    /// frames; phases are moved with it, by whole pixels, looked at the first time alone.
    #[test]
    fn content_that_moves_is_foreseen_and_phases_go_with_it() {
        let display = display();
        let encoder = Encoder::new(&display, &[Color::Green], 8).unwrap();
        let mut moments =
            MotionCompensation::of(encoder.lighting(false), SET_NS, frame(&display, 0, 1)[0].problem.pixel());
        let frame_ns = 2 * SET_NS;
        let mut shown = 0;
        for k in 0..5i64 {
            moments.follow(&frame(&display, 4 * k as usize, 1), k * frame_ns);
            for light_ns in [k * frame_ns, k * frame_ns + SET_NS] {
                let motion = moments.motion(light_ns, &eye(None));
                if k < 2 {
                    assert_eq!(motion.content, [0.0; 2], "one displacement is no motion yet");
                } else {
                    assert!((motion.content[0] - 2.0).abs() < 0.1 && motion.content[1].abs() < 0.1, "{motion:?}");
                    let at = -((light_ns - k * frame_ns) as f64) / SET_NS as f64;
                    assert!((motion.at - at).abs() < 1e-6 && motion.eye.is_none(), "{motion:?}");
                }
                if let Some(look) = moments.find_shifts(light_ns, 0) {
                    assert_eq!(look, k < 2 || (k == 2 && light_ns == k * frame_ns), "frame {k}");
                    moments.carried(true);
                    shown += moments.shifts[0][0];
                }
            }
        }
        // Of the last frame's second set.
        assert_eq!(shown, 4 * 4 + 2);
        // Half a second later it has stopped where the last frame has it.
        assert!(moments.motion(4 * frame_ns + 500_000_000, &eye(None)).is_still());
        assert_eq!(moments.find_shifts(4 * frame_ns + 500_000_000, 0), Some(false));
        assert_eq!(moments.shifts, [[-2, 0]]);
        // Another picture is another content.
        moments.follow(&frame(&display, 0, 2), 5 * frame_ns);
        assert!(moments.motion(5 * frame_ns, &eye(None)).is_still() && moments.find_shifts(5 * frame_ns, 0).is_none());
    }

    /// Two answers to requests for one light, whose moments differ by nanoseconds: a pixel between them is no velocity, and the
    /// motion of the content stays what it is.
    #[test]
    fn two_frames_of_one_light_are_no_motion() {
        let display = display();
        let encoder = Encoder::new(&display, &[Color::Green], 8).unwrap();
        let frame_ns = 2 * SET_NS;
        for gap_ns in [1, -1, 0, 2, 50, -50, 1000, 100_000, 1_000_000, -1_000_000, 1_999_000] {
            for (apart, moving) in [(0, 4), (1, 4), (1, 0), (2, 0)] {
                let mut moments =
                    MotionCompensation::of(encoder.lighting(false), SET_NS, frame(&display, 0, 1)[0].problem.pixel());
                for k in 0..6i64 {
                    let shift = (moving * k) as usize;
                    moments.follow(&frame(&display, shift, 1), k * frame_ns);
                    for again in [false, true] {
                        let [x, y] = moments.motion(k * frame_ns, &eye(None)).content;
                        let want = if k < 2 { 0.0 } else { moving as f64 / 2.0 };
                        // What the second answer shows elsewhere is taken back by the next frame.
                        assert!((x - want).abs() < 0.1 && y.abs() < 0.1, "{gap_ns} ns, {apart} px, {k} {again}: {x}");
                        moments.follow(&frame(&display, shift + apart, 1), k * frame_ns + gap_ns);
                    }
                    moments.find_shifts(k * frame_ns, 0);
                    moments.carried(true);
                    let stands = (moments.carried[0][0] / moments.pixel).round() as i64;
                    assert_eq!(stands, moving * k + apart as i64, "phases go where the picture went");
                }
            }
        }
    }

    /// Of sets that roll, what was lit moves on by a set's motion for its next turn, and what is still to be lit stays.
    #[test]
    fn of_sets_that_roll_what_was_lit_moves_on_by_a_set() {
        let display = Display { height: SIDE, width: SIDE, ..Display::preset("grey8").unwrap() };
        let encoder = Encoder::new(&display, &[Color::Green], 8).unwrap();
        let mut moments =
            MotionCompensation::of(encoder.lighting(true), SET_NS, frame(&display, 0, 1)[0].problem.pixel());
        let turn_ns = SET_NS / 8;
        let mut stands = [0; 8];
        for n in 0..64i64 {
            let light_ns = n * turn_ns;
            if n % 8 == 0 {
                moments.follow(&frame(&display, 4 * (n / 8) as usize, 1), light_ns);
            }
            let turn = (n % 8) as usize;
            if moments.find_shifts(light_ns, turn).is_some() {
                let moved = moments.shifts.iter().filter(|shift| **shift != [0; 2]).count();
                assert!(n < 24 || moved <= 2, "{n}: {:?}", moments.shifts);
                stands.iter_mut().zip(&moments.shifts).for_each(|(stands, shift)| *stands += shift[0]);
                moments.carried(true);
            }
            for (i, stands) in stands.iter().enumerate().filter(|_| n >= 16) {
                // Four pixels a set, each with its own turn.
                let there = 4.0 * (n as f64 + ((i + 8 - turn) % 8) as f64) / 8.0;
                assert!((f64::from(*stands as i32) - there).abs() <= 0.7, "{n}, {i}: {stands}, not {there}");
            }
        }
    }

    #[test]
    fn an_eye_rests_or_follows_or_does_as_its_tracker_says() {
        let content = [10.0, 0.0];
        for (turning, is) in [
            (None, (None, 0.0)),
            (Some(([9.0, 0.5], 1.0)), (Some(content), 0.0)),
            (Some(([0.5, 0.5], 1.0)), (Some([0.0; 2]), 0.0)),
            (Some(([6.0, 0.0], 6.0)), (None, 0.0)),
            (Some(([0.0, 30.0], 2.0)), (Some([0.0, 30.0]), 2.0)),
        ] {
            assert_eq!(turns(content, turning), is, "{turning:?}");
        }
        // Nothing moves: there is nothing to compute.
        assert_eq!(turns([0.0; 2], Some(([1.0, 0.0], 1.0))), (Some([0.0; 2]), 0.0));
    }
}
