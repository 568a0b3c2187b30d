//! Places a moving eye at each sub-frame's time and shifts the sub-frames for it (OPTICS 15).

use super::{Comparison, Planner, PupilPass};
use crate::optics::Pupil;
use eyebox_kernels::motion::Shift;

/// The eye and the content at the time of one sub-frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// The pupil. All moments of an eye focus at one depth.
    pub pupil: Pupil,
    /// Turn of the eye since the content was at its place in the scene, pixels (x, y).
    pub eye: [f64; 2],
    /// Movement of the scene's content, pixels (x, y).
    pub content: [f64; 2],
    /// True if this is one of the sub-frames that the eye averages.
    pub seen: bool,
}

/// An eye that moves in front of sub-frames at even intervals, with content that moves.
///
/// Times are in sets, of `count` sub-frames each. Sub-frame `f` of `S` is lit at `(f - (S - 1)/2) / count`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moving {
    /// The pupil at time 0.
    pub pupil: Pupil,
    /// Movement of the pupil, meters per set (x, y).
    pub drift: [f64; 2],
    /// Turn of the eye, pixels per set (x, y).
    pub eye: [f64; 2],
    /// Movement of the content, pixels per set (x, y).
    pub content: [f64; 2],
    /// The time at which the content is at its place in the scene.
    pub at: f64,
    /// Middle and length of the time in which all sub-frames are lit, sets. `[0, 1]` spreads them evenly over the
    /// set.
    pub lit: [f64; 2],
    /// The first sub-frame that the eye averages.
    pub first: usize,
    /// Number of sub-frames that the eye averages. After the last sub-frame the first follows again.
    pub count: usize,
}

impl Moving {
    /// Returns an eye at rest that averages all of `frames` sub-frames of a still scene.
    pub fn resting(pupil: Pupil, frames: usize) -> Self {
        let still = [0.0; 2];
        Self { pupil, drift: still, eye: still, content: still, at: 0.0, lit: [0.0, 1.0], first: 0, count: frames }
    }

    /// Returns true if this equals [`resting`](Self::resting).
    pub fn is_resting(&self, frames: usize) -> bool {
        *self == Self { at: self.at, lit: self.lit, ..Self::resting(self.pupil, frames) }
    }

    /// Returns the moments of `frames` sub-frames.
    pub fn moments(&self, frames: usize) -> Vec<Moment> {
        self.each_moment(frames).collect()
    }

    /// Returns the same, sub-frame by sub-frame.
    pub(super) fn each_moment(self, frames: usize) -> impl Iterator<Item = Moment> + Clone + use<> {
        let count = self.count.clamp(1, frames.max(1));
        let one = move |frame: usize| {
            // After the last sub-frame of a stream the first ones follow again, later.
            let along = (frame + frames - self.first % frames) % frames;
            let t = ((self.first + along) as f64 - (frames as f64 - 1.0) / 2.0) / count as f64;
            let t = self.lit[0] + self.lit[1] * t;
            let [dx, dy] = self.drift.map(|v| v * t);
            Moment {
                pupil: Pupil { x: self.pupil.x + dx, y: self.pupil.y + dy, ..self.pupil },
                // The place of the picture on the retina is free, because an eye that follows it sees it at its place
                // in the scene.
                eye: self.eye.map(|g| g * (t - self.at)),
                content: self.content.map(|v| v * (t - self.at)),
                seen: along < count,
            }
        };
        (0..frames).map(one)
    }
}

impl Planner {
    /// Plans the pass of a moving eye. The windows of a list hold all sub-frames, and `motion` leaves only the
    /// sub-frames that the eye sees. Its light is from a pupil that covers all moments, cut to the pupil of each
    /// moment. The error of an imperfect eye stays centered on the middle moment.
    pub fn moving_pass(&self, moments: &[Moment], comparison: &Comparison) -> PupilPass {
        let mut pass = PupilPass::empty();
        self.refill_moving(&mut pass, moments.iter().copied(), comparison);
        pass
    }

    /// Refills a finished pass as [`moving_pass`](Self::moving_pass), in the lists that it has.
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
                // The light of each moment is over the share of its own pupil.
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
    /// Lights the sub-frames with these powers, each over their mean, instead of the former powers. It is for an eye
    /// at rest, whose table only weighs.
    pub fn set_powers(&mut self, powers: &[f64]) {
        self.set_powers_by_mode(|_| powers.iter().copied());
    }

    /// Lights the sub-frames with separate powers for each mode. `of` returns the powers of one of the planner's
    /// modes.
    pub(crate) fn set_powers_by_mode<P: Iterator<Item = f64> + Clone>(&mut self, of: impl Fn(usize) -> P) {
        let still = |power: f64| Shift { turns: [0.0; 3], weight: power.sqrt() };
        self.with_modes(std::iter::repeat(()), |pass, ()| {
            let Self { moments, spans, source_mode, .. } = pass;
            let powers = of(*source_mode);
            moments.refill(powers.clone().map(still), powers.flat_map(|_| spans.iter().copied()));
        });
    }
}

/// Returns the smallest disc around the middle of their range that holds these pupils.
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
