//! The kernels, each a row of the table in `kernels/table.rs`: names, scopes, what is read and written, work, arguments.

use super::{ModelTables, PupilPass, Resource, Shape};
use eyebox_kernels::fft::Columns;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;

/// What a kernel runs over; neighbours of one scope may run frame by frame, or pupil pass by pupil pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// Each sub-frame by itself.
    Frames,
    /// Each sub-frame of each pupil by itself.
    Windows,
    /// Each pupil by itself, all sub-frames.
    PupilPasses,
    /// Once.
    Whole,
}

impl Scope {
    /// Whether pupils go through such kernels one by one.
    pub(crate) fn is_per_pupil(self) -> bool {
        matches!(self, Self::Windows | Self::PupilPasses)
    }
}

/// What a kernel does with a resource.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// Reads it.
    Read,
    /// Replaces what is there.
    Write,
    /// Reads it and leaves something else, or adds to it.
    Update,
}

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
}

/// One entry of the list.
#[derive(Debug, Clone, PartialEq)]
pub struct Dispatch {
    /// Which kernel.
    pub kernel: Kernel,
    /// Over which pupil passes, where the kernel looks at pupil passes. Pupil pass `i` uses slot `i - pupil_passes.start`.
    pub pupil_passes: Range<usize>,
}

/// Time spent in one kernel. On the CPU, the sum over threads.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing {
    /// Which.
    pub kernel: Kernel,
    /// How often it ran (per frame or pupil pass on the CPU).
    pub calls: u64,
    /// Seconds in all.
    pub seconds: f64,
}

/// A row of the table, as far as plans look at it.
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
        /// A kernel of the list. Each has a module of its name in `kernels`; the transforms are one kernel over three
        /// buffers.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum Kernel {
            $($(#[$doc])* $kernel,)*
        }

        impl Kernel {
            /// All of them, in the order of a step.
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

        /// A list and its arguments: one step of a solve, or a look at a hologram.
        #[derive(Debug, Clone, PartialEq)]
        pub struct Step {
            /// The kernels, in order.
            pub list: Vec<Dispatch>,
            /// The pupils.
            pub pupil_passes: Vec<PupilPass>,
            /// Columns of the spectrum that any pupil passes.
            pub columns: Columns,
            /// What the display does to the light beside showing phases.
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

    /// The name by which it is timed and chosen, and that its module has.
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// The kernel of this name, or of the name that it had before.
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

    /// What the CPU engine runs it over.
    pub(crate) fn scope(self) -> Scope {
        self.row().scope
    }

    /// Whose rate its work is priced with.
    pub fn group(self) -> Group {
        self.row().group
    }

    /// What it reads and writes, in the order of its shader's bindings.
    pub(crate) fn binds(self) -> &'static [(Access, Resource)] {
        self.row().binds
    }

    /// What it leaves something in.
    pub fn writes(self) -> impl Iterator<Item = Resource> {
        self.binds().iter().filter(|(access, _)| *access != Access::Read).map(|(_, resource)| *resource)
    }

    /// Whether it looks at the pupil passes of its dispatch.
    pub(crate) fn takes_pupil_passes(self) -> bool {
        self.binds().iter().any(|(_, resource)| resource.is_per_pupil())
    }

    /// Whether the pupil passes of a dispatch add to the same values: one after the other, in their order.
    pub fn accumulates_over_pupils(self) -> bool {
        self.takes_pupil_passes() && self.writes().any(|resource| resource.is_shared())
    }

    /// Whether the step's arguments for it are for buffers of this shape.
    pub fn fits(self, step: &Step, shape: &Shape) -> bool {
        (self.row().fits)(step, shape)
    }
}

/// What a kernel's work is counted of: a pupil pass, or a sub-frame.
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

    /// Pixels of the window.
    fn window(&self) -> f64 {
        self.pass.map_or(0.0, |pass| pass.count() as f64)
    }

    /// Values of all retinal fields: of each mode of the source, of each sub-frame.
    fn fields(&self) -> f64 {
        self.pass.map_or(0.0, |pass| pass.mode_count() as f64) * self.frames() * self.window()
    }

    /// Bins that the pupil passes, in all modes.
    fn passing(&self) -> f64 {
        self.pass.map_or(0.0, |pass| pass.passing() as f64)
    }

    /// Work of shifting all sub-frames, where the eye moves.
    fn moving(&self) -> f64 {
        if self.pass.is_some_and(PupilPass::moves) { self.frames() * self.passing() } else { 0.0 }
    }

    /// Pixels of the photograph before it is resampled.
    fn level(&self) -> f64 {
        let shot = self.pass.and_then(|pass| pass.shot.as_ref());
        shot.map_or(0.0, |shot| f64::from(shot.args.height * shot.args.width))
    }

    /// Samples of views that the photograph reads.
    fn taps(&self) -> f64 {
        let shot = self.pass.and_then(|pass| pass.shot.as_ref());
        shot.map_or(0.0, |s| 0.5 * s.taps.len() as f64 * f64::from(s.args.height) * f64::from(s.args.width))
    }

    fn grid_transform(&self) -> f64 {
        let place = &self.shape.place;
        transform(place.grid_height as usize, place.grid_width as usize, self.step.columns.count)
    }

    /// All rows and columns of the grid.
    fn full_transform(&self) -> f64 {
        let place = &self.shape.place;
        transform(place.grid_height as usize, place.grid_width as usize, place.grid_width as usize)
    }

    /// Pixels of the mask.
    fn masked(&self) -> f64 {
        (self.shape.model.mask * self.shape.model.mask) as f64 * self.pixels()
    }

    fn subpixels(&self) -> f64 {
        self.shape.subpixels() as f64
    }

    /// Along one axis, to or from all sub-pixels along it: the mean of both axes.
    fn crosstalk(&self) -> f64 {
        let [down, along] = self.shape.model.crosstalk.unwrap_or_default();
        CROSSTALK * (down + along + 1) as f64 * self.subpixels() * self.pixels()
    }

    /// Between the field's spectrum and all sub-pixels' fields: rows of all, and columns of as many as there are along y.
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

/// What a weight of crosstalk takes for a pixel.
const CROSSTALK: f64 = 0.04;

/// A transform of `rows` x `columns` points of which `used` columns are needed.
fn transform(rows: usize, columns: usize, used: usize) -> f64 {
    let along = |n: usize| 0.2 * (n.max(2) as f64).log2();
    let (rows, columns, used) = (rows as f64, columns as f64, used as f64);
    rows * columns * along(columns as usize) + rows * used * along(rows as usize)
}

impl Dispatch {
    /// A kernel that looks at no pupil pass.
    pub fn whole(kernel: Kernel) -> Self {
        Self { kernel, pupil_passes: 0..0 }
    }

    /// Units of its work in a step; about a nanosecond of one core each.
    pub fn work(&self, step: &Step, shape: &Shape) -> f64 {
        let of = |pass| (self.kernel.row().work)(&Unit { step, shape, pass });
        if self.kernel.takes_pupil_passes() {
            step.pupil_passes[self.pupil_passes.clone()].iter().map(|pass| of(Some(pass))).sum()
        } else {
            shape.frames as f64 * of(None)
        }
    }
}
