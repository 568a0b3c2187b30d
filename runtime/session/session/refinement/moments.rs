//! Estimates the motion during a set (OPTICS 15): of content from its frames, and of the eye from its tracker.

use crate::encode::{Lighting, LitTimes};
use crate::scene::displacement;
use crate::session::refinement::field::LiveColor;
use crate::session::refinement::pupil_tracker::PupilEstimate;
use crate::solve::{Motion, Problem};

/// Content that moves by less than this in a set is still (pixels).
const STILL_BELOW_PX: f64 = 0.5;
/// Two successive displacements are one motion if they differ by at most this share of it, plus the next constant in
/// pixels per frame.
const SAME_MOTION_RATIO: f64 = 0.5;
const SAME_MOTION_PX: f64 = 1.0;
/// Frames that are farther apart than this give no motion (s).
const MAX_FRAME_GAP_S: f64 = 0.15;
/// Frames that are closer than this show one time (s). Two answers to requests for one light differ by a nanosecond,
/// and one pixel in that time would be 16,666,666 pixels per set. Content has at most 480 frames per second.
const ONE_MOMENT: f64 = 2e-3;
/// Content has stopped after this many intervals without a new frame.
const STOPPED: f64 = 2.5;
/// Views from places that are farther apart than this show another parallax (m).
const SAME_PLACE: f64 = 0.25e-3;
/// Two velocities differ for certain if they differ by more than this many standard deviations.
const SURE: f64 = 3.0;
/// A pupil that moves by less than this in a set rests (m).
const RESTS: f64 = 2e-5;

/// The view from which motion is estimated.
struct ReferenceView {
    picture: Vec<f32>,
    size: [usize; 2],
    /// The angle of a pixel of the picture (radians).
    pixel: f64,
    center: [f64; 2],
    shows_ns: i64,
}

/// The estimated motion of content and eye. The default has no motion, and treats all sub-frames of a set as lit at the
/// same time.
#[derive(Default)]
pub struct MotionCompensation {
    /// The times of the sub-frames of each color, and the duration of a set (ns). It is `None` if motion is not
    /// compensated.
    lit: Option<(Lighting, i64)>,
    seen: Option<ReferenceView>,
    /// The position of the content (radians) at the end of the last displacement, and the time of that end (ns).
    since: Option<([f64; 2], i64)>,
    /// The last displacement and the time between its frames (s). The next field is the velocity (radians per second),
    /// which is set if the previous displacement agrees.
    displaced: Option<([f64; 2], f64)>,
    velocity: [f64; 2],
    /// The position of the content in the last frame, since the content began (radians). The next field is the position
    /// at which the phases of each turn show it.
    position: [f64; 2],
    carried: Vec<[f64; 2]>,
    /// The whole pixels of the first color by which the phases of each turn have to be shifted.
    shifts: Vec<[i64; 2]>,
    /// The angle of a pixel of the first color (radians).
    pixel: f64,
    /// True if phases that were shifted with this motion had a lower loss.
    trusted: bool,
}

impl MotionCompensation {
    /// Creates a compensation for sub-frames at times of their own, in sets that follow each other after `set_ns`.
    /// `pixel` is the angle of a pixel of the first color (radians).
    pub fn of(lighting: Lighting, set_ns: i64, pixel: f64) -> Self {
        let (carried, shifts) = (vec![[0.0; 2]; lighting.turns()], vec![[0; 2]; lighting.turns()]);
        Self { lit: Some((lighting, set_ns)), pixel, carried, shifts, ..Self::default() }
    }

    /// Creates a compensation for these colors on a display with this lighting, if `counts` is true.
    pub(crate) fn when(counts: bool, lighting: Lighting, set_ns: i64, colors: &[LiveColor]) -> Self {
        let first = colors.first().filter(|_| counts);
        first.map_or_else(Self::default, |first| Self::of(lighting, set_ns, first.problem.pixel()))
    }

    /// Returns the times of the sub-frames of each color from this turn on.
    pub fn times(&self, turn: usize) -> &[LitTimes] {
        self.lit.as_ref().map_or(&[], |(lighting, _)| lighting.times(turn))
    }

    /// Returns the shifts that [`find_shifts`](Self::find_shifts) found for the sub-frames of each turn, in pixels of
    /// the first color. Returns the lighting of the display with them.
    pub fn shifts(&self) -> Option<(&[[i64; 2]], &Lighting)> {
        self.lit.as_ref().map(|(lighting, _)| (self.shifts.as_slice(), lighting))
    }

    /// Takes another content frame, which shows the time `shows_ns`.
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
            // The eye has moved, and the views with it. The content is assumed to continue its motion.
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
        // The phases follow the picture.
        self.position = [0, 1].map(|i| self.position[i] + moved[i]);
        if elapsed < ONE_MOMENT {
            // The same time is shown again at a slightly different place, which gives no velocity.
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
            // This is a jump or the start of a motion, so no motion is predicted.
            (self.velocity, self.trusted) = ([0.0; 2], false);
        }
        self.displaced = Some((moved, elapsed));
    }

    /// Starts with other content, at its present position.
    fn cut(&mut self) {
        (self.displaced, self.velocity, self.trusted) = (None, [0.0; 2], false);
        self.since = self.seen.as_ref().map(|seen| (self.position, seen.shows_ns));
        self.carried.fill(self.position);
    }

    /// States that the phases were solved for the last frame.
    pub fn begun_again(&mut self) {
        self.carried.fill(self.position);
    }

    /// Returns the velocity of the content (radians per second) and the time since the last frame, if the content still
    /// moves at `light_ns`.
    fn content(&self, light_ns: i64) -> Option<([f64; 2], f64)> {
        let (seen, (_, set_ns)) = (self.seen.as_ref()?, self.lit.as_ref()?);
        let (_, interval) = self.displaced?;
        let since = light_ns.saturating_sub(seen.shows_ns) as f64 * 1e-9;
        let a_set = *set_ns as f64 * 1e-9 * self.velocity[0].hypot(self.velocity[1]);
        let moves =
            a_set >= STILL_BELOW_PX * self.pixel && since.abs() <= STOPPED * interval + 2.0 * *set_ns as f64 * 1e-9;
        moves.then_some((self.velocity, since))
    }

    /// Finds the whole pixels of the first color by which the phases have to be shifted to show the content at their
    /// light.
    ///
    /// The sub-frames of `turn` are lit at `light_ns`, and the others one after the other until their next turn.
    /// Returns true if the losses have to be compared first, and `None` if no shift is needed.
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

    /// Records that the phases were shifted, or that they stay because that has the lower loss.
    pub fn carried(&mut self, moved: bool) {
        for (carried, shift) in self.carried.iter_mut().zip(&self.shifts) {
            *carried = [0, 1].map(|i| carried[i] + shift[i] as f64 * self.pixel);
        }
        self.trusted = moved && self.velocity != [0.0; 2];
    }

    /// Returns the motion during a set with the reference time `light_ns`, for this estimate of the eye, in pixels of
    /// the first color.
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

/// Returns the rotation of the eye in pixels per set, and its spread. The eye rests, follows the content, or moves as
/// the tracker measures. It is `None` if the eye may rest or follow.
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

/// Returns the middle view at a size that is quick to compare.
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

    /// A picture of blobs that is `shift` pixels to the right, with wraparound at the edges.
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

    /// Content has 30 frames per second on 60 sets, with 4 pixels per frame. This is two pixels per set from the third
    /// frame on, extrapolated between frames. Phases are shifted with it by whole pixels, and losses are compared only
    /// the first time.
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
        // The last two pixels come from the second set of the last frame.
        assert_eq!(shown, 4 * 4 + 2);
        // Half a second later it has stopped at its position in the last frame.
        assert!(moments.motion(4 * frame_ns + 500_000_000, &eye(None)).is_still());
        assert_eq!(moments.find_shifts(4 * frame_ns + 500_000_000, 0), Some(false));
        assert_eq!(moments.shifts, [[-2, 0]]);
        // Another picture is other content.
        moments.follow(&frame(&display, 0, 2), 5 * frame_ns);
        assert!(moments.motion(5 * frame_ns, &eye(None)).is_still() && moments.find_shifts(5 * frame_ns, 0).is_none());
    }

    /// Two answers to requests for one light differ in time by nanoseconds. A pixel between them is no velocity, and
    /// the motion of the content stays the same.
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
                        // The next frame reverses the displacement of the second answer.
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

    /// With rolling updates, sub-frames that were lit shift by the motion of a set for their next turn. Sub-frames that
    /// are still to be lit stay.
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
                // The content moves by four pixels per set, and each sub-frame is lit in its own turn.
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
        // Without motion there is nothing to compute.
        assert_eq!(turns([0.0; 2], Some(([1.0, 0.0], 1.0))), (Some([0.0; 2]), 0.0));
    }
}
