//! An eye that moves while the sub-frames are shown (OPTICS 15): which pupil looks at each, and what it is shifted by.

use super::{Comparison, Planner, PupilPass};
use crate::optics::Pupil;
use eyebox_kernels::motion::Shift;

/// One sub-frame at its moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// The pupil; all moments of an eye focus at one depth.
    pub pupil: Pupil,
    /// How far the eye has turned since the content was where the scene shows it, pixels (x, y).
    pub eye: [f64; 2],
    /// How far what the scene shows has moved, pixels (x, y).
    pub content: [f64; 2],
    /// Whether it is among the sub-frames that the eye averages.
    pub seen: bool,
}

/// An eye before sub-frames that follow each other at even intervals, and what moves in them.
///
/// Times are in sets: `count` sub-frames are one, and sub-frame `f` of `S` is lit at `(f - (S - 1)/2) / count`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moving {
    /// The pupil at time 0.
    pub pupil: Pupil,
    /// How it moves, metres a set (x, y).
    pub drift: [f64; 2],
    /// How the eye turns, pixels a set (x, y).
    pub eye: [f64; 2],
    /// How the content moves, pixels a set (x, y).
    pub content: [f64; 2],
    /// When the content is where the scene shows it.
    pub at: f64,
    /// When all sub-frames are lit: the middle of that time, and its length, sets; `[0, 1]` where they are evenly in the set.
    pub lit: [f64; 2],
    /// The first sub-frame that the eye averages,
    pub first: usize,
    /// and how many: those behind the last are the first again.
    pub count: usize,
}

impl Moving {
    /// An eye at rest that averages all of `frames` sub-frames of a scene that stands still.
    pub fn resting(pupil: Pupil, frames: usize) -> Self {
        let still = [0.0; 2];
        Self { pupil, drift: still, eye: still, content: still, at: 0.0, lit: [0.0, 1.0], first: 0, count: frames }
    }

    /// Whether it is no more than [`resting`](Self::resting).
    pub fn is_resting(&self, frames: usize) -> bool {
        *self == Self { at: self.at, lit: self.lit, ..Self::resting(self.pupil, frames) }
    }

    /// The moments of `frames` sub-frames.
    pub fn moments(&self, frames: usize) -> Vec<Moment> {
        self.each_moment(frames).collect()
    }

    /// The same, sub-frame by sub-frame.
    pub(super) fn each_moment(self, frames: usize) -> impl Iterator<Item = Moment> + Clone + use<> {
        let count = self.count.clamp(1, frames.max(1));
        let one = move |frame: usize| {
            // Behind the last of a stream its first come again, later.
            let along = (frame + frames - self.first % frames) % frames;
            let t = ((self.first + along) as f64 - (frames as f64 - 1.0) / 2.0) / count as f64;
            let t = self.lit[0] + self.lit[1] * t;
            let [dx, dy] = self.drift.map(|v| v * t);
            Moment {
                pupil: Pupil { x: self.pupil.x + dx, y: self.pupil.y + dy, ..self.pupil },
                // Where the picture stands on the retina is free: whoever follows it sees it where the scene has it.
                eye: self.eye.map(|g| g * (t - self.at)),
                content: self.content.map(|v| v * (t - self.at)),
                seen: along < count,
            }
        };
        (0..frames).map(one)
    }
}

impl Planner {
    /// What an eye that moves needs: a list's windows hold all sub-frames, of which `motion` leaves those that it sees. Its
    /// light is that of a pupil wide enough for all moments, cut to each moment's own; an imperfect eye's error stays centred
    /// on the middle one.
    pub fn moving_pass(&self, moments: &[Moment], comparison: &Comparison) -> PupilPass {
        let mut pass = PupilPass::empty();
        self.refill_moving(&mut pass, moments.iter().copied(), comparison);
        pass
    }

    /// Makes [`moving_pass`](Self::moving_pass) of one that is over, in the lists that it has.
    pub(super) fn refill_moving(
        &self,
        pass: &mut PupilPass,
        moments: impl Iterator<Item = Moment> + Clone,
        comparison: &Comparison,
    ) {
        let iris = |pupil: &Pupil| self.model.as_ref().map_or(*pupil, |model| model.model().true_pupil(pupil));
        let seen = moments.clone().filter(|moment| moment.seen);
        let count = seen.clone().count();
        let Some(middle) = seen.clone().nth(count / 2) else {
            let pupil = moments.clone().next().map_or(Pupil::from_mm([0.0, 0.0, 1.0, 0.0]), |moment| moment.pupil);
            return self.refill(pass, &pupil, comparison);
        };
        let middle = iris(&middle.pupil);
        let share = self.grid.share(middle.diameter);
        self.refill_wave(pass, &around(seen.clone().map(|m| iris(&m.pupil))), share, count, comparison);
        self.see_with_eye(pass, &middle);
        let size = [self.grid.width as f64, self.grid.height as f64];
        pass.with_modes(std::iter::repeat(()), |pass, ()| {
            let (window, of, (mode, optics)) = (pass.window, pass.source_mode, self.mode(pass.source_mode));
            let shift = |(frame, moment): (usize, Moment)| {
                let [along, down] = [0, 1].map(|i| moment.eye[i] / size[i]);
                let first = along * window.x0 as f64 + down * window.y0 as f64;
                // Each moment's light over its own pupil's share.
                let power = self.power(of, frame);
                let own = self.grid.share(iris(&moment.pupil).diameter);
                let weight = if moment.seen { (power * share / own).sqrt() } else { 0.0 };
                Shift { turns: [down, along, first], weight }
            };
            let spans = |m: Moment| window.each_span(&optics, &mode.pupil(&iris(&m.pupil), optics.focal_length));
            pass.moments.refill(moments.clone().enumerate().map(shift), moments.clone().flat_map(spans));
        });
        let (high, wide) = self.grid.field_of_view();
        let pixel = [wide / size[0], high / size[1]];
        let resting = self.displacement(&middle);
        let place = |m: Moment| (m.pupil, [0, 1].map(|i| resting[i] + (m.content[i] - m.eye[i]) * pixel[i]));
        let looks = seen.map(place);
        let alike = looks.clone().zip(looks.clone().skip(1)).all(|(one, next)| one == next);
        pass.shot = self.shot_over(looks.take(if alike { 1 } else { count }), pass.window, pass.shot.take());
    }
}

impl PupilPass {
    /// Lights its sub-frames with these powers, each over their mean, in place of those that it had: of an eye at rest, whose
    /// table does no more than weigh.
    pub fn set_powers(&mut self, powers: &[f64]) {
        self.set_powers_by_mode(|_| powers.iter().copied());
    }

    /// The same with powers of each mode's own; `of` is asked for those of one of the planner's modes.
    pub(crate) fn set_powers_by_mode<P: Iterator<Item = f64> + Clone>(&mut self, of: impl Fn(usize) -> P) {
        let still = |power: f64| Shift { turns: [0.0; 3], weight: power.sqrt() };
        self.with_modes(std::iter::repeat(()), |pass, ()| {
            let Self { moments, spans, source_mode, .. } = pass;
            let powers = of(*source_mode);
            moments.refill(powers.clone().map(still), powers.flat_map(|_| spans.iter().copied()));
        });
    }
}

/// The smallest disc about the middle of their range that holds these.
fn around(pupils: impl Iterator<Item = Pupil> + Clone) -> Pupil {
    let Some(first) = pupils.clone().next() else { return Pupil::from_mm([0.0, 0.0, 1.0, 0.0]) };
    let range = |of: fn(Pupil) -> f64| {
        let values = pupils.clone().map(of);
        (values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max))
    };
    let ((left, right), (top, bottom)) = (range(|p| p.x), range(|p| p.y));
    let (x, y) = (0.5 * (left + right), 0.5 * (top + bottom));
    let diameter = pupils.map(|p| p.diameter + 2.0 * (p.x - x).hypot(p.y - y)).fold(0.0, f64::max);
    Pupil { x, y, diameter, ..first }
}
