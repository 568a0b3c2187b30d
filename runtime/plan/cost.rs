//! What a step costs, in units that can be counted before anything runs: work per group of kernels, and bytes.

use super::{Kernel, PupilPass, Purpose, Shape, Step};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Kernels that take about the same time per unit of work wherever they stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Group {
    /// From phases to the spectrum, all sub-frames.
    Field,
    /// `quantise` alone: only SLMs with levels need it.
    Levels,
    /// The photographs of the pupils.
    Photograph,
    /// Everything that looks through a pupil's window, down and up.
    Window,
    /// From the changed spectrum to the phases.
    Update,
}

impl Group {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Field, Self::Levels, Self::Photograph, Self::Window, Self::Update];

    /// The group of a kernel.
    pub fn of(kernel: Kernel) -> Self {
        match kernel {
            Kernel::Quantise => Self::Levels,
            Kernel::Clear | Kernel::Modulate | Kernel::FieldForward | Kernel::Energy => Self::Field,
            Kernel::Photograph | Kernel::Resample => Self::Photograph,
            Kernel::DivideByOverlap
            | Kernel::EqualiseEyebox
            | Kernel::CheckFinite
            | Kernel::ChangeInverse
            | Kernel::Project
            | Kernel::Adam => Self::Update,
            _ => Self::Window,
        }
    }
}

/// Units of work of each group in a step; about a nanosecond of one core each.
pub fn work(step: &Step, shape: &Shape) -> [f64; Group::ALL.len()] {
    let mut work = [0.0; Group::ALL.len()];
    for dispatch in &step.list {
        let pupil_passes = &step.pupil_passes[dispatch.pupil_passes.clone()];
        let each = |one: &dyn Fn(&PupilPass) -> f64| pupil_passes.iter().map(one).sum::<f64>();
        work[Group::of(dispatch.kernel) as usize] += match dispatch.kernel {
            Kernel::Photograph => each(&taps),
            Kernel::Resample => each(&|pupil_pass| {
                let shot = pupil_pass.shot.as_ref().map_or(0.0, |s| f64::from(s.args.height * s.args.width));
                shot + pupil_pass.count() as f64
            }),
            Kernel::WindowInverse | Kernel::WindowForward => {
                each(&|l| shape.frames as f64 * transform(l.window.rows, l.window.columns, l.columns.count))
            }
            Kernel::PassPupil | Kernel::ReturnPupil => each(&|l| shape.frames as f64 * passing(l)),
            Kernel::Overlap => each(&passing),
            Kernel::Transfer | Kernel::Taper => each(&|l| 4.0 * passing(l)),
            Kernel::Intensity | Kernel::ApplyFactor => each(&|l| (shape.frames * l.count()) as f64 * 0.5),
            Kernel::Compare | Kernel::Exposure => each(&|l| l.count() as f64 * 2.0),
            kernel => shape.frames as f64 * over_frame(kernel, step, shape),
        };
    }
    work
}

/// Of one sub-frame.
fn over_frame(kernel: Kernel, step: &Step, shape: &Shape) -> f64 {
    let (rows, columns) = (shape.place.grid_height as usize, shape.place.grid_width as usize);
    let (pixels, points) = (shape.pixels() as f64, shape.points() as f64);
    match kernel {
        Kernel::Clear => 0.5 * points,
        Kernel::Quantise => pixels * f64::from(step.quantise.levels.max(2)).log2(),
        Kernel::Modulate => 2.0 * pixels,
        Kernel::FieldForward | Kernel::ChangeInverse => transform(rows, columns, step.columns.count),
        Kernel::Energy | Kernel::EqualiseEyebox | Kernel::DivideByOverlap => points,
        Kernel::CheckFinite => 0.5 * points,
        _ => 4.0 * pixels,
    }
}

/// A transform of `rows` x `columns` points of which `used` columns are needed.
fn transform(rows: usize, columns: usize, used: usize) -> f64 {
    let along = |n: usize| 0.2 * (n.max(2) as f64).log2();
    let (rows, columns, used) = (rows as f64, columns as f64, used as f64);
    rows * columns * along(columns as usize) + rows * used * along(rows as usize)
}

/// Bins that a pupil passes.
fn passing(pupil_pass: &PupilPass) -> f64 {
    pupil_pass.spans.iter().map(|[first, end]| f64::from(end - first)).sum()
}

/// Samples of views that a photograph reads.
fn taps(pupil_pass: &PupilPass) -> f64 {
    pupil_pass
        .shot
        .as_ref()
        .map_or(0.0, |s| 0.5 * s.taps.len() as f64 * f64::from(s.args.height) * f64::from(s.args.width))
}

/// Bytes of the buffers that are not a pupil pass's, where a complex value takes `complex` of them.
pub fn shared_bytes(shape: &Shape, complex: u64) -> u64 {
    let (pixels, points, frames) = (shape.pixels() as u64, shape.points() as u64, shape.frames as u64);
    let mut bytes = 4 * frames * pixels + complex * frames * points;
    if shape.purpose != Purpose::View {
        bytes += 4 * frames * pixels + complex * frames * points + 4 * points;
    }
    if shape.purpose == Purpose::Adam {
        bytes += 4 * frames * pixels;
    }
    if shape.quantised {
        bytes += 4 * frames * pixels;
    }
    bytes
}

/// Bytes of one pupil pass's buffers, where a complex value of its window takes `complex` of them.
pub fn pupil_pass_bytes(pupil_pass: &PupilPass, frames: usize, complex: u64) -> u64 {
    let count = pupil_pass.count() as u64;
    let shot = pupil_pass.shot.as_ref().map_or(0, |s| 4 * u64::from(s.args.height) * u64::from(s.args.width));
    // The window, the transfer function, image and target, the photograph before it is resampled.
    complex * count * frames as u64 + 8 * count + 8 * count + shot
}

/// Bytes that the pupil passes of each slot come to over these steps: a slot keeps what its largest pupil pass took.
#[derive(Debug, Clone, Default)]
pub struct Slots(Vec<u64>);

impl Slots {
    /// Sees a step.
    pub fn see(&mut self, step: &Step, frames: usize, complex: u64) {
        let mut seen: Option<Range<usize>> = None;
        for range in step.list.iter().map(|d| &d.pupil_passes).filter(|l| !l.is_empty()) {
            if seen.as_ref() == Some(range) {
                continue;
            }
            seen = Some(range.clone());
            self.0.resize(self.0.len().max(range.len()), 0);
            for (slot, pupil_pass) in self.0.iter_mut().zip(&step.pupil_passes[range.clone()]) {
                *slot = (*slot).max(pupil_pass_bytes(pupil_pass, frames, complex));
            }
        }
    }

    /// All of them together, where the first holds a pupil pass of so many bytes as well.
    pub fn bytes_with(&self, first: u64) -> u64 {
        let [head, tail @ ..] = &self.0[..] else { return first };
        (*head).max(first) + tail.iter().sum::<u64>()
    }
}
