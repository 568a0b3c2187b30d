//! An eye that moves while the sub-frames are shown (OPTICS 15): which pupil looks at each, and what it is shifted by.

use super::{Comparison, Planner, PupilPass};
use crate::optics::{Pupil, Window};
use eyebox_kernels::motion::{Shift, Table};

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
        let count = self.count.clamp(1, frames.max(1));
        let one = |frame: usize| {
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
        (0..frames).map(one).collect()
    }
}

impl Planner {
    /// What an eye that moves needs: a list's windows hold all sub-frames, of which `motion` leaves those that it sees. Its
    /// light is that of a pupil wide enough for all moments, cut to each moment's own; an imperfect eye's error stays centred
    /// on the middle one.
    pub fn moving_pass(&self, moments: &[Moment], comparison: &Comparison) -> PupilPass {
        let iris = |pupil: &Pupil| self.model.as_ref().map_or(*pupil, |model| model.model().true_pupil(pupil));
        let seen: Vec<&Moment> = moments.iter().filter(|moment| moment.seen).collect();
        let Some(middle) = seen.get(seen.len() / 2).or(seen.first()) else {
            let pupil = moments.first().map_or(Pupil::from_mm([0.0, 0.0, 1.0, 0.0]), |moment| moment.pupil);
            return self.pupil_pass(&pupil, comparison);
        };
        let irises: Vec<Pupil> = moments.iter().map(|moment| iris(&moment.pupil)).collect();
        let around = around(irises.iter().zip(moments).filter(|(_, m)| m.seen).map(|(iris, _)| iris));
        let share = self.grid.share(iris(&middle.pupil).diameter);
        let mut pass = self.pupil_pass_of(&around, share, seen.len(), comparison);
        let window = pass.window;
        self.see_with_eye(&mut pass, &iris(&middle.pupil));
        let size = [self.grid.width as f64, self.grid.height as f64];
        let table = |of: usize, window: &Window| {
            let (mode, optics) = self.mode(of);
            let sub_frame = |(frame, (moment, iris)): (usize, (&Moment, &Pupil))| {
                let [along, down] = [0, 1].map(|i| moment.eye[i] / size[i]);
                let first = along * window.x0 as f64 + down * window.y0 as f64;
                // Each moment's light over its own pupil's share.
                let power = self.power(of, frame);
                let weight = if moment.seen { (power * share / self.grid.share(iris.diameter)).sqrt() } else { 0.0 };
                let spans = window.spans(&optics, &mode.pupil(iris, optics.focal_length));
                (Shift { turns: [down, along, first], weight }, spans)
            };
            Some(Table::new(&moments.iter().zip(&irises).enumerate().map(sub_frame).collect::<Vec<_>>()))
        };
        pass.moments = table(pass.source_mode, &window);
        for further in &mut pass.modes {
            further.moments = table(further.source_mode, &further.window);
        }
        let (high, wide) = self.grid.field_of_view();
        let pixel = [wide / size[0], high / size[1]];
        let resting = self.displacement(&iris(&middle.pupil));
        let mut looks: Vec<(Pupil, [f64; 2])> = Vec::with_capacity(seen.len());
        let place = |m: &Moment| (m.pupil, [0, 1].map(|i| resting[i] + (m.content[i] - m.eye[i]) * pixel[i]));
        looks.extend(seen.iter().map(|moment| place(moment)));
        if looks.iter().all(|look| *look == looks[0]) {
            looks.truncate(1);
        }
        pass.shot = self.shot_over(&looks, window);
        pass
    }
}

impl PupilPass {
    /// Lights its sub-frames with these powers, each over their mean, in place of those that it had: of an eye at rest, whose
    /// table does no more than weigh.
    pub(crate) fn set_powers(&mut self, powers: &[f64]) {
        self.set_powers_by_mode(|_| powers.to_vec());
    }

    /// The same with powers of each mode's own; `of` is asked for those of one of the planner's modes.
    pub(crate) fn set_powers_by_mode(&mut self, of: impl Fn(usize) -> Vec<f64>) {
        let still = |power: &f64| Shift { turns: [0.0; 3], weight: power.sqrt() };
        let table = |mode: usize, spans: &Vec<[u32; 2]>| {
            Table::new(&of(mode).iter().map(|p| (still(p), spans.clone())).collect::<Vec<_>>())
        };
        self.moments = Some(table(self.source_mode, &self.spans));
        for mode in &mut self.modes {
            mode.moments = Some(table(mode.source_mode, &mode.spans));
        }
    }
}

/// The smallest disc about the middle of their range that holds these.
fn around<'a>(pupils: impl Iterator<Item = &'a Pupil> + Clone) -> Pupil {
    let Some(first) = pupils.clone().next() else { return Pupil::from_mm([0.0, 0.0, 1.0, 0.0]) };
    let range = |of: fn(&Pupil) -> f64| {
        let values = pupils.clone().map(of);
        (values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max))
    };
    let ((left, right), (top, bottom)) = (range(|p| p.x), range(|p| p.y));
    let (x, y) = (0.5 * (left + right), 0.5 * (top + bottom));
    let diameter = pupils.map(|p| p.diameter + 2.0 * (p.x - x).hypot(p.y - y)).fold(0.0, f64::max);
    Pupil { x, y, diameter, ..*first }
}
