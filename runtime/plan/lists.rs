//! The lists that engines run.

use super::{Dispatch, Kernel, Lane, Planner, Step};
use eyebox_kernels::{adam, balance, fft::Columns, project};
use std::ops::Range;

impl Planner {
    /// One step of the projection (OPTICS 6b), `in_flight` values of window at a time.
    pub fn project_step(&self, lanes: Vec<Lane>, in_flight: usize, power: f64, gain: f64, momentum: f64) -> Step {
        let mut step = self.descend(lanes, in_flight, true);
        step.list.push(Dispatch { kernel: Kernel::Project, lanes: 0..0 });
        step.balance.power = power as f32;
        step.project.gain = gain as f32;
        step.project.momentum = momentum as f32;
        step
    }

    /// One step of Adam, the `t`-th, counted from 1 (OPTICS 4).
    pub fn adam_step(&self, lanes: Vec<Lane>, in_flight: usize, t: usize, rate: f64) -> Step {
        let mut step = self.descend(lanes, in_flight, false);
        step.list.push(Dispatch { kernel: Kernel::Adam, lanes: 0..0 });
        let (beta1, beta2) = (0.9f64, 0.999f64);
        let correct = |beta: f64| (1.0 / (1.0 - beta.powi(t.min(1 << 20) as i32))) as f32;
        step.adam = adam::Args {
            place: self.place(),
            rate: rate as f32,
            beta1: beta1 as f32,
            beta2: beta2 as f32,
            correct1: correct(beta1),
            correct2: correct(beta2),
            // 1e-8 for a loss times 1000, as the paper's code scales it.
            epsilon: 1e-11,
        };
        step
    }

    /// The intensity through each pupil, left in `Image` of slots 0, 1, ...: what `view` shows.
    pub fn view_step(&self, lanes: Vec<Lane>) -> Step {
        let all = 0..lanes.len();
        let mut step = self.empty(lanes);
        step.list.extend([Kernel::Modulate, Kernel::FieldForward].map(|kernel| Dispatch { kernel, lanes: 0..0 }));
        step.list.extend(
            [Kernel::Transfer, Kernel::PassPupil, Kernel::WindowInverse, Kernel::Intensity]
                .map(|kernel| Dispatch { kernel, lanes: all.clone() }),
        );
        step
    }

    /// The photograph of each pupil, left in `Target` of slots 0, 1, ...
    pub fn photograph_step(&self, lanes: Vec<Lane>) -> Step {
        let all = 0..lanes.len();
        let mut step = self.empty(lanes);
        step.list.extend([Kernel::Photograph, Kernel::Resample].map(|kernel| Dispatch { kernel, lanes: all.clone() }));
        step
    }

    /// What each pupil sees, what it should see, and the sums of both, pupil after pupil: the first two entries are
    /// shared, then come [`EXPOSURE_LIST`](Self::EXPOSURE_LIST) entries a pupil, which leave its `Sums` in slot 0.
    pub fn exposure_step(&self, lanes: Vec<Lane>) -> Step {
        let count = lanes.len();
        let mut step = self.empty(lanes);
        step.list.extend([Kernel::Modulate, Kernel::FieldForward].map(|kernel| Dispatch { kernel, lanes: 0..0 }));
        for i in 0..count {
            step.list.extend(Self::EXPOSURE_LIST.map(|kernel| Dispatch { kernel, lanes: i..i + 1 }));
        }
        step
    }

    /// One pupil's kernels in [`exposure_step`](Self::exposure_step).
    pub const EXPOSURE_LIST: [Kernel; 7] = [
        Kernel::Transfer,
        Kernel::PassPupil,
        Kernel::WindowInverse,
        Kernel::Intensity,
        Kernel::Photograph,
        Kernel::Resample,
        Kernel::Exposure,
    ];

    fn empty(&self, lanes: Vec<Lane>) -> Step {
        let columns = Columns::union(self.grid.width, lanes.iter().map(Lane::grid_columns));
        let place = self.place();
        Step {
            list: Vec::new(),
            columns,
            balance: balance::Args { grid_height: place.grid_height, grid_width: place.grid_width, power: 1.0 },
            project: project::Args { place, gain: 0.0, momentum: 0.0 },
            adam: adam::Args {
                place,
                rate: 0.0,
                beta1: 0.9,
                beta2: 0.999,
                correct1: 1.0,
                correct2: 1.0,
                epsilon: 1e-11,
            },
            lanes,
        }
    }

    /// Down to the window, compare, and up again; lanes come in groups whose windows fit `in_flight` values.
    fn descend(&self, lanes: Vec<Lane>, in_flight: usize, balanced: bool) -> Step {
        let groups = groups(&lanes, in_flight / self.frames.max(1));
        let mut step = self.empty(lanes);
        let whole = |kernel| Dispatch { kernel, lanes: 0..0 };
        step.list.extend([Kernel::Modulate, Kernel::FieldForward, Kernel::Clear].map(whole));
        for lanes in groups {
            let over = |kernel| Dispatch { kernel, lanes: lanes.clone() };
            if balanced {
                step.list.push(over(Kernel::Overlap));
            }
            step.list.extend(
                [
                    Kernel::Transfer,
                    Kernel::Photograph,
                    Kernel::Resample,
                    Kernel::PassPupil,
                    Kernel::WindowInverse,
                    Kernel::Intensity,
                    Kernel::Compare,
                    Kernel::Weigh,
                    Kernel::WindowForward,
                    Kernel::ReturnPupil,
                ]
                .map(over),
            );
        }
        if balanced {
            step.list.push(whole(Kernel::Balance));
        }
        step.list.push(whole(Kernel::ChangeInverse));
        step
    }
}

/// Neighbouring lanes whose windows hold at most `most` values together (one lane at least).
fn groups(lanes: &[Lane], most: usize) -> Vec<Range<usize>> {
    let mut groups = Vec::new();
    let (mut start, mut held) = (0, 0);
    for (i, lane) in lanes.iter().enumerate() {
        if i > start && held + lane.count() > most {
            groups.push(start..i);
            (start, held) = (i, 0);
        }
        held += lane.count();
    }
    if start < lanes.len() {
        groups.push(start..lanes.len());
    }
    groups
}
