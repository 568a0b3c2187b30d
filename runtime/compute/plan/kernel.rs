//! Defines the kernels from the table in `kernels/table.rs`, with their scopes, buffers, work and arguments.

use super::{ModelTables, PupilPass, Resource, Shape};
use eyebox_kernels::fft::Columns;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;

/// The unit over which a kernel runs. Neighbors of one scope may run frame by frame, or pupil pass by pupil pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// Each sub-frame by itself.
    Frames,
    /// Each sub-frame of each pupil by itself.
    Windows,
    /// Each pupil by itself, with all its sub-frames.
    PupilPasses,
    /// All sub-frames in one run.
    Whole,
}

impl Scope {
    /// Returns true if such kernels take one pupil at a time.
    pub(crate) fn is_per_pupil(self) -> bool {
        matches!(self, Self::Windows | Self::PupilPasses)
    }
}

/// The access of a kernel to a resource.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// Reads the resource only.
    Read,
    /// Replaces the resource's content.
    Write,
    /// Reads the resource and changes it, or adds to it.
    Update,
}

/// Kernels with about the same time per unit of work, wherever they are in a list.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Group {
    /// From phases to the spectrum, all sub-frames.
    Field,
    /// `quantise` alone, which only SLMs with levels need.
    Levels,
    /// The target images of the pupils.
    Photograph,
    /// Everything in a pupil's spectral window, to the image and back.
    Window,
    /// Kernels from the changed spectrum to the phases.
    Update,
}

impl Group {
    /// All groups, in order.
    pub const ALL: [Self; 5] = [Self::Field, Self::Levels, Self::Photograph, Self::Window, Self::Update];
}

/// One entry of the list.
#[derive(Debug, Clone, PartialEq)]
pub struct Dispatch {
    /// The kernel that runs.
    pub kernel: Kernel,
    /// Range of pupil passes, empty for a kernel that reads none. Pupil pass `i` uses slot `i - pupil_passes.start`.
    pub pupil_passes: Range<usize>,
}

/// Time spent in one kernel. On the CPU it is the sum over threads.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing {
    /// The kernel that ran.
    pub kernel: Kernel,
    /// Number of runs, on the CPU per frame or per pupil pass.
    pub calls: u64,
    /// Total time in seconds.
    pub seconds: f64,
    /// Bytes of its buffers that it read and wrote, 0 if they were not counted.
    pub bytes: u64,
    /// Operations of its transforms, 0 if they were not counted. A complex transform of n values has 5 n log2(n).
    pub operations: u64,
}

/// A row of the table, with the columns that plans need.
struct Row {
    name: &'static str,
    scope: Scope,
    group: Group,
    binds: &'static [(Access, Resource)],
    fits: fn(&Step, &Shape) -> bool,
    work: fn(&Unit<'_>) -> f64,
}

macro_rules! define {
    ($(
        $(#[$doc:meta])*
        $kernel:ident = $name:literal {
            over: $scope:ident, group: $group:ident,
            binds: [$($access:ident $resource:ident),*],
            $(args: $args:ident: $type:ty,)?
            $(fits: $fits:expr,)?
            work: $work:expr,
            twin: $twin:expr,
            shader: $how:ident $shader:expr,
        }
    )*) => {
        /// A kernel of the list. Each kernel has a module of its name in `kernels`, but the transforms are one kernel
        /// over three buffers.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum Kernel {
            $($(#[$doc])* $kernel,)*
        }

        impl Kernel {
            /// All kernels, in the order of a step.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$kernel),*];

            const ROWS: [Row; Self::ALL.len()] = [$(Row {
                name: $name,
                scope: Scope::$scope,
                group: Group::$group,
                binds: &[$((Access::$access, Resource::$resource)),*],
                fits: {
                    let _fits: fn(&Step, &Shape) -> bool = |_, _| true;
                    $(let _fits: fn(&Step, &Shape) -> bool = $fits;)?
                    _fits
                },
                work: $work,
            }),*];
        }

        /// A list with its arguments, which is one step of a solve, or the simulation of a hologram's images.
        #[derive(Debug, Clone, PartialEq)]
        pub struct Step {
            /// The kernels, in order.
            pub list: Vec<Dispatch>,
            /// The passes of the pupils.
            pub pupil_passes: Vec<PupilPass>,
            /// Columns of the spectrum that at least one pupil passes.
            pub columns: Columns,
            /// Effects of the display on the light besides showing phases.
            pub model: Option<Arc<ModelTables>>,
            $($(
                #[doc = concat!("Arguments of `", $name, "`.")]
                pub $args: $type,
            )?)*
        }
    };
}
eyebox_kernels::kernels!(define);

impl Kernel {
    fn row(self) -> &'static Row {
        &Self::ROWS[self as usize]
    }

    /// Returns the name of the kernel in timings and options, which is also the name of its module.
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// Returns the kernel of this name, or of a former name.
    pub fn by_name(name: &str) -> Option<Self> {
        let before = [
            ("weigh", "apply_factor"),
            ("guard", "check_finite"),
            ("balance", "divide_by_overlap"),
            ("even", "equalise_eyebox"),
            ("drive_back", "drive_adjoint"),
            ("lag_back", "lag_adjoint"),
            ("return_pupil", "pupil_adjoint"),
            ("turn", "phase_gradient"),
            ("turn_mask", "phase_gradient_mask"),
            ("turn_subpixels", "phase_gradient_subpixels"),
        ];
        let name = before.iter().find(|(old, _)| *old == name).map_or(name, |(_, new)| new);
        Self::ALL.into_iter().find(|k| k.name() == name)
    }

    /// Returns the unit over which the CPU engine runs it.
    pub(crate) fn scope(self) -> Scope {
        self.row().scope
    }

    /// Returns the group whose rate prices its work.
    pub fn group(self) -> Group {
        self.row().group
    }

    /// Returns the resources that it reads and writes, in the order of its shader's bindings.
    pub(crate) fn binds(self) -> &'static [(Access, Resource)] {
        self.row().binds
    }

    /// Returns the resources that it changes.
    pub fn writes(self) -> impl Iterator<Item = Resource> {
        self.binds().iter().filter(|(access, _)| *access != Access::Read).map(|(_, resource)| *resource)
    }

    /// Returns true if it transforms and does nothing else.
    fn is_transform(self) -> bool {
        matches!(self, Self::FieldForward | Self::WindowInverse | Self::WindowForward | Self::ChangeInverse)
    }

    /// Returns true if it reads the pupil passes of its dispatch.
    pub(crate) fn takes_pupil_passes(self) -> bool {
        self.binds().iter().any(|(_, resource)| resource.is_per_pupil())
    }

    /// Returns true if the pupil passes of a dispatch add to the same values. They then run one after the other, in
    /// order.
    pub fn accumulates_over_pupils(self) -> bool {
        self.takes_pupil_passes() && self.writes().any(|resource| resource.is_shared())
    }

    /// Returns true if the step's arguments of this kernel fit buffers of this shape.
    pub fn fits(self, step: &Step, shape: &Shape) -> bool {
        (self.row().fits)(step, shape)
    }
}

/// The unit in which a kernel's work is counted, a pupil pass or a sub-frame.
struct Unit<'a> {
    step: &'a Step,
    shape: &'a Shape,
    pass: Option<&'a PupilPass>,
}

impl Unit<'_> {
    fn frames(&self) -> f64 {
        self.shape.frames as f64
    }

    fn pixels(&self) -> f64 {
        self.shape.pixels() as f64
    }

    fn points(&self) -> f64 {
        self.shape.points() as f64
    }

    /// Returns the pixels of the spectral window.
    fn window(&self) -> f64 {
        self.pass.map_or(0.0, |pass| pass.count() as f64)
    }

    /// Returns the values of all retinal fields, over the modes of the source and the sub-frames.
    fn fields(&self) -> f64 {
        self.pass.map_or(0.0, |pass| pass.mode_count() as f64) * self.frames() * self.window()
    }

    /// Returns the bins that the pupil passes, in all modes.
    fn passing(&self) -> f64 {
        self.pass.map_or(0.0, |pass| pass.passing() as f64)
    }

    /// Returns the work of shifting all sub-frames, 0 if the eye does not move.
    fn moving(&self) -> f64 {
        if self.pass.is_some_and(PupilPass::moves) { self.frames() * self.passing() } else { 0.0 }
    }

    /// Returns the pixels of the target image before it is resampled.
    fn level(&self) -> f64 {
        let shot = self.pass.and_then(|pass| pass.shot.as_ref());
        shot.map_or(0.0, |shot| f64::from(shot.args.height * shot.args.width))
    }

    /// Returns the samples of views that the target image reads.
    fn taps(&self) -> f64 {
        let shot = self.pass.and_then(|pass| pass.shot.as_ref());
        shot.map_or(0.0, |s| 0.5 * s.taps.len() as f64 * f64::from(s.args.height) * f64::from(s.args.width))
    }

    fn grid_transform(&self) -> f64 {
        let place = &self.shape.place;
        transform(place.grid_height as usize, place.grid_width as usize, self.step.columns.count)
    }

    /// Returns the work of a transform over all rows and columns of the grid.
    fn full_transform(&self) -> f64 {
        let place = &self.shape.place;
        transform(place.grid_height as usize, place.grid_width as usize, place.grid_width as usize)
    }

    /// Returns the pixels of the mask.
    fn masked(&self) -> f64 {
        (self.shape.model.mask * self.shape.model.mask) as f64 * self.pixels()
    }

    fn subpixels(&self) -> f64 {
        self.shape.subpixels() as f64
    }

    /// Returns the work along one axis, to or from all sub-pixels along it, as the mean of both axes.
    fn crosstalk(&self) -> f64 {
        let [down, along] = self.shape.model.crosstalk.unwrap_or_default();
        CROSSTALK * (down + along + 1) as f64 * self.subpixels() * self.pixels()
    }

    /// Returns the work between the field's spectrum and the fields of all sub-pixels. All of them need their rows,
    /// but only those along y need columns.
    fn subpixels_transform(&self) -> f64 {
        let (place, p) = (&self.shape.place, self.subpixels());
        let (rows, columns) = (place.grid_height as usize, place.grid_width as usize);
        let along = transform(rows, columns, 0);
        p * p * along + p * (self.grid_transform() - along) + 0.5 * (p * p + p) * self.points()
    }

    fn window_transform(&self) -> f64 {
        let one = |pass: &PupilPass| transform(pass.window.rows, pass.window.columns, pass.columns.count);
        self.pass.map_or(0.0, |pass| pass.each_mode().map(one).sum())
    }
}

/// Units of work of one weight of crosstalk per pixel.
const CROSSTALK: f64 = 0.04;

/// Units of work of a transform per point and per doubling of the length.
const BUTTERFLIES: f64 = 0.2;
/// Operations of a complex transform per point and per doubling of the length, by the usual count of n log2(n).
const OPERATIONS: f64 = 5.0;

/// Returns the work of a transform of `rows` x `columns` points, of which `used` columns are needed.
fn transform(rows: usize, columns: usize, used: usize) -> f64 {
    let along = |n: usize| BUTTERFLIES * (n.max(2) as f64).log2();
    let (rows, columns, used) = (rows as f64, columns as f64, used as f64);
    rows * columns * along(columns as usize) + rows * used * along(rows as usize)
}

impl Dispatch {
    /// Makes a dispatch of a kernel that reads no pupil pass.
    pub fn whole(kernel: Kernel) -> Self {
        Self { kernel, pupil_passes: 0..0 }
    }

    /// Returns the units of its work in a step. A unit is about a nanosecond of one core.
    pub fn work(&self, step: &Step, shape: &Shape) -> f64 {
        let of = |pass| (self.kernel.row().work)(&Unit { step, shape, pass });
        if self.kernel.takes_pupil_passes() {
            step.pupil_passes[self.pupil_passes.clone()].iter().map(|pass| of(Some(pass))).sum()
        } else {
            shape.frames as f64 * of(None)
        }
    }
    /// Returns the operations of its transforms, 0 for other kernels.
    pub fn operations(&self, step: &Step, shape: &Shape) -> u64 {
        if self.kernel.is_transform() { (self.work(step, shape) / BUTTERFLIES * OPERATIONS) as u64 } else { 0 }
    }
}
