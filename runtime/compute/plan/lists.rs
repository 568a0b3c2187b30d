//! Makes the lists of kernels that engines run.

use super::{Dispatch, Kernel, ModelParts, Planner, PupilPass, Purpose, Step, Storage};
use crate::optics::Geometry;
use eyebox_kernels::{
    adam, divide_by_overlap, drive, energy, equalise_eyebox, fft::Columns, modulate_mask, project, quantise,
};
use std::ops::Range;

/// The kernels of a step in a pupil's spectral window, from the spectrum to the image and back. `Motion` and its
/// adjoint run only if an eye moves.
pub(super) const THROUGH_A_WINDOW: [Kernel; 8] = [
    Kernel::PassPupil,
    Kernel::Motion,
    Kernel::WindowInverse,
    Kernel::Intensity,
    Kernel::Compare,
    Kernel::ApplyFactor,
    Kernel::WindowForward,
    Kernel::MotionBack,
];

/// The kernels from the spectrum to the image of a pupil.
const TO_THE_IMAGE: [Kernel; 8] = [
    Kernel::Transfer,
    Kernel::Relay,
    Kernel::Eye,
    Kernel::Taper,
    Kernel::PassPupil,
    Kernel::Motion,
    Kernel::WindowInverse,
    Kernel::Intensity,
];

/// Share of the variance of random drives that marks weak crosstalk. If crosstalk leaves this share or more, phases
/// may wrap, because a bound would cost 0.1 dB (docs/results/solver-and-model.json).
const WEAK_CROSSTALK: f64 = 0.9;

/// The allocations of a step's lists, for its pupil passes and its kernels. A finished step gives back both.
#[derive(Debug, Default)]
pub struct StepLists {
    /// The pupil passes of the step.
    pub pupil_passes: Vec<PupilPass>,
    kernels: Vec<Dispatch>,
}

impl From<Vec<PupilPass>> for StepLists {
    fn from(pupil_passes: Vec<PupilPass>) -> Self {
        Self { pupil_passes, kernels: Vec::new() }
    }
}

impl From<Step> for StepLists {
    fn from(Step { pupil_passes, list: kernels, .. }: Step) -> Self {
        Self { pupil_passes, kernels }
    }
}

impl Planner {
    /// Makes one step of the projection (OPTICS 6b) with `in_flight` window values at a time. `lists` may be from a
    /// finished step.
    pub fn project_step(
        &self,
        lists: impl Into<StepLists>,
        in_flight: usize,
        power: f64,
        gain: f64,
        momentum: f64,
    ) -> Step {
        let mut step = self.descend(lists, in_flight, true);
        step.list.push(Dispatch::whole(Kernel::Project));
        step.divide_by_overlap.power = power as f32;
        // A pixel follows the mean of all its mask pixels.
        let parts = self.slm.mask_factor.pow(2) as f64;
        step.project.gain = (gain / parts / self.change_scale_of(&step.pupil_passes, true)) as f32;
        step.project.momentum = momentum as f32;
        step
    }

    /// Makes step `t` of Adam, counted from 1 (OPTICS 4). `lists` may be from a finished step.
    pub fn adam_step(&self, lists: impl Into<StepLists>, in_flight: usize, t: usize, rate: f64) -> Step {
        let mut step = self.descend(lists, in_flight, false);
        step.list.push(Dispatch::whole(Kernel::Adam));
        // These are the float32 values, so that the corrections match the moments that the kernel keeps. In float32,
        // 1 - 0.999 is off by a part in 80,000, and every step would be off as much without this (docs/precision.md).
        let (beta1, beta2) = (f64::from(0.9f32), f64::from(0.999f32));
        let correct = |beta: f64| (1.0 / (1.0 - beta.powi(t.min(1 << 20) as i32))) as f32;
        step.adam = adam::Args {
            place: self.place(),
            rate: rate as f32,
            beta1: beta1 as f32,
            beta2: beta2 as f32,
            correct1: correct(beta1),
            correct2: correct(beta2),
            // The value is 1e-8 for a loss times 1000, the scale in the paper's code. Moments are in the change's
            // units.
            epsilon: (1e-11 * self.change_scale_of(&step.pupil_passes, false)) as f32,
        };
        step
    }

    /// Makes the step that leaves the intensity through each pupil in `Image` of slots 0, 1, ... for `render`.
    pub fn view_step(&self, pupil_passes: Vec<PupilPass>) -> Step {
        let all = 0..pupil_passes.len();
        let mut step = self.empty(pupil_passes);
        step.list.extend(self.to_spectrum());
        step.over_pupil_passes(all, &TO_THE_IMAGE);
        step
    }

    /// Makes the step that carries the derivatives of a function of the images back to the phases (OPTICS 4). It takes
    /// one pupil pass after the other, each in slot 0. Before each `ApplyFactor`, `Image` holds the image, and the caller
    /// replaces it by the derivatives with respect to its pixels, times the gain of the pass's `intensity`. At the end,
    /// the derivatives with respect to the phases are `2 Im(conj(u) Change)`, with `u = exp(i phase)`. Fields are stored as
    /// float32, and the pupil passes have a [`Comparison`](super::Comparison) of intensities.
    pub fn adjoint_step(&self, pupil_passes: Vec<PupilPass>) -> Step {
        const BACK: [Kernel; 4] =
            [Kernel::ApplyFactor, Kernel::WindowForward, Kernel::MotionBack, Kernel::PupilAdjoint];
        let mut step = self.empty(pupil_passes);
        step.list.extend(self.to_spectrum());
        step.list.push(Dispatch::whole(Kernel::Clear));
        for i in 0..step.pupil_passes.len() {
            step.over_pupil_passes(i..i + 1, &TO_THE_IMAGE);
            step.over_pupil_passes(i..i + 1, &BACK);
        }
        step.list.extend(self.to_field());
        step.list.extend(self.to_phases());
        step
    }

    /// Makes the step that leaves the fields of all sub-frames behind each pupil in `Window`, and its target image in
    /// `Target`, of slots 0, 1, ...
    pub fn fields_step(&self, pupil_passes: Vec<PupilPass>) -> Step {
        let all = 0..pupil_passes.len();
        let mut step = self.view_step(pupil_passes);
        step.over_pupil_passes(all, &[Kernel::Photograph, Kernel::Resample]);
        step
    }

    /// Makes the step that leaves the target image of each pupil in `Target` of slots 0, 1, ...
    pub fn photograph_step(&self, pupil_passes: Vec<PupilPass>) -> Step {
        let all = 0..pupil_passes.len();
        let mut step = self.empty(pupil_passes);
        step.over_pupil_passes(all, &[Kernel::Photograph, Kernel::Resample]);
        step
    }

    /// Adds the term that equalizes the light over the eyebox (OPTICS 7, pupil-aware). It pulls patches of the square
    /// of side `eyebox` meters around the axis, as far as they are inside its disc, to their mean with this weight.
    pub fn with_equalised_eyebox(&self, mut step: Step, eyebox: f64, patches: usize, weight: f64) -> Step {
        let projects = step.list.last().is_some_and(|d| d.kernel == Kernel::Project);
        // The projection's factors are ratios of energies, and the gradient's are proportional to 1 / energy.
        let (change, field) =
            (self.change_scale_of(&step.pupil_passes, projects), f64::from(self.shape(Purpose::View).field_scale()));
        let weight = weight * change * if projects { 1.0 / field } else { field };
        step.equalise_eyebox = self.equalise_eyebox(eyebox, patches, projects, weight);
        let after = |step: &Step, kernel| step.list.iter().position(|d| d.kernel == kernel).map_or(0, |i| i + 1);
        use Kernel::{FieldForward, Modulate, ModulateWave, SubpixelsForward};
        let lit = [FieldForward, SubpixelsForward, Modulate, ModulateWave].map(|kernel| after(&step, kernel));
        let lit = lit.into_iter().max().unwrap_or(0);
        step.list.insert(lit, Dispatch::whole(Kernel::Energy));
        // This is before the spectrum's change becomes the field's. In the far field both are the same.
        use Kernel::{Adam, ChangeInverse, CheckFinite, PhaseGradient, Project, SubpixelsInverse};
        let ends = [ChangeInverse, SubpixelsInverse, CheckFinite, PhaseGradient, Project, Adam];
        let end = step.list.iter().position(|d| ends.contains(&d.kernel)).unwrap_or(step.list.len());
        step.list.insert(end, Dispatch::whole(Kernel::EqualiseEyebox));
        step.columns = Columns { first: 0, count: self.grid.width };
        step
    }

    fn equalise_eyebox(&self, eyebox: f64, patches: usize, projects: bool, weight: f64) -> equalise_eyebox::Args {
        let (bin_y, bin_x) = self.grid.bin_size();
        let count = |n: usize, bin: f64| ((eyebox / bin).round() as usize).clamp(1, n);
        let (rows, columns) = (count(self.grid.height, bin_y), count(self.grid.width, bin_x));
        let (y0, x0) = self.grid.index_of(-(rows as i64 / 2), -(columns as i64 / 2));
        let place = self.place();
        let points = (self.grid.height * self.grid.width) as f64;
        equalise_eyebox::Args {
            place: energy::Args {
                grid_height: place.grid_height,
                grid_width: place.grid_width,
                y0: y0 as u32,
                x0: x0 as u32,
                rows: rows as u32,
                columns: columns as u32,
                patches: patches.clamp(1, energy::MOST as usize) as u32,
                accumulate: 0,
            },
            mode: if projects { equalise_eyebox::PROJECTION } else { equalise_eyebox::GRADIENT },
            // The change is in units of the spectrum over the grid's points (see `pupil_pass`).
            weight: if projects && self.grid.geometry == Geometry::Relay { weight / points } else { weight } as f32,
            limit: 3.0,
        }
    }

    /// Makes the step for the field on the SLM of content at several depths. `PupilAdjoint` adds the spectrum of each
    /// pupil pass's `Window`, which the caller writes before entries `3 i .. 3 i + 3` run. The rest of the list
    /// leaves the field in `Change`.
    pub fn layers_step(&self, pupil_passes: Vec<PupilPass>) -> Step {
        let mut step = self.empty(pupil_passes);
        for i in 0..step.pupil_passes.len() {
            let kernels = [Kernel::Transfer, Kernel::WindowForward, Kernel::PupilAdjoint];
            step.list.extend(kernels.map(|kernel| Dispatch { kernel, pupil_passes: i..i + 1 }));
        }
        step.list.extend(self.to_field());
        step
    }

    /// Returns the kernels from phases to the values that a pupil cuts a window out of. These are the spectrum or, in
    /// the far field, the field itself.
    fn to_spectrum(&self) -> impl Iterator<Item = Dispatch> + use<> {
        let first = (self.levels > 0).then_some(Kernel::Quantise);
        let parts = self.parts();
        let (lit, spectrum) = match (parts.mask, parts.more_subpixels) {
            (1.., _) => (Kernel::ModulateMask, Kernel::FieldForward),
            (_, 0) => (Kernel::ModulateWave, Kernel::FieldForward),
            _ => (Kernel::ModulateSubpixels, Kernel::SubpixelsForward),
        };
        let away = parts.mask_away.then_some(Kernel::ToMask);
        let last = (self.grid.geometry == Geometry::Relay).then_some(spectrum);
        let lag = self.lags().then_some(Kernel::Lag);
        let crosstalk = parts.crosstalk.map(|_| [Kernel::CrosstalkRows, Kernel::CrosstalkColumns]);
        let driven =
            [Kernel::Drive].into_iter().chain(lag).chain(crosstalk.into_iter().flatten()).chain([lit]).chain(away);
        let plain = (!parts.drives).then_some(Kernel::Modulate);
        let all = first.into_iter().chain(plain).chain(driven.filter(move |_| parts.drives)).chain(last);
        all.map(Dispatch::whole)
    }

    /// Returns the kernels from the change of the field to the change of the phases, if a model is between both.
    fn to_phases(&self) -> impl Iterator<Item = Dispatch> + use<> {
        let parts = self.parts();
        let lag = self.lags().then_some(Kernel::LagAdjoint);
        let gradient = match (parts.mask, parts.more_subpixels) {
            (1.., _) => Kernel::PhaseGradientMask,
            (_, 0) => Kernel::PhaseGradient,
            _ => Kernel::PhaseGradientSubpixels,
        };
        let away = parts.mask_away.then_some(Kernel::FromMask);
        let crosstalk = parts.crosstalk.map(|_| [Kernel::CrosstalkColumnsBack, Kernel::CrosstalkRowsBack]);
        let all = away
            .into_iter()
            .chain([gradient])
            .chain(crosstalk.into_iter().flatten())
            .chain(lag)
            .chain([Kernel::DriveAdjoint]);
        all.filter(move |_| parts.drives).map(Dispatch::whole)
    }

    fn lags(&self) -> bool {
        self.model.as_ref().is_some_and(|model| model.model().lag > 0.0)
    }

    fn parts(&self) -> ModelParts {
        self.model.as_ref().map(|model| model.parts()).unwrap_or_default()
    }

    /// Returns the kernel from the change of the spectrum back to the change of the field, if there is a relay.
    fn to_field(&self) -> Option<Dispatch> {
        let relay = self.grid.geometry == Geometry::Relay;
        let several = self.parts().more_subpixels > 0;
        relay.then(|| Dispatch::whole(if several { Kernel::SubpixelsInverse } else { Kernel::ChangeInverse }))
    }

    /// Makes the step that leaves the sums of each viewpoint's image and target image in `Sums` of slots 0, 1, ...
    pub fn exposure_step(&self, pupil_passes: Vec<PupilPass>) -> Step {
        let all = 0..pupil_passes.len();
        let mut step = self.fields_step(pupil_passes);
        step.over_pupil_passes(all, &[Kernel::Exposure]);
        step
    }

    /// Makes a step over these pupil passes with an empty list.
    fn empty(&self, lists: impl Into<StepLists>) -> Step {
        let StepLists { pupil_passes, kernels: mut list } = lists.into();
        list.clear();
        let columns = Columns::union(
            self.grid.width,
            pupil_passes.iter().flat_map(PupilPass::each_mode).map(PupilPass::grid_columns),
        );
        let place = self.place();
        Step {
            list,
            columns,
            divide_by_overlap: divide_by_overlap::Args {
                grid_height: place.grid_height,
                grid_width: place.grid_width,
                power: 1.0,
            },
            quantise: quantise::Args {
                count: (self.slm.height * self.slm.width) as u32,
                levels: self.levels as u32,
                hardness: 1.0,
            },
            equalise_eyebox: self.equalise_eyebox(0.0, 1, false, 0.0),
            project: project::Args { place, gain: 0.0, momentum: 0.0, bound: self.bound(), step: 0 },
            adam: adam::Args {
                place,
                rate: 0.0,
                beta1: 0.9,
                beta2: 0.999,
                correct1: 1.0,
                correct2: 1.0,
                epsilon: 1e-11,
            },
            drive: self.drive(),
            modulate_mask: self.modulate_mask(),
            model: self.model.clone(),
            pupil_passes,
        }
    }

    fn drive(&self) -> drive::Args {
        let ([bend_sin, bend_cos], lag) =
            self.model.as_ref().map_or(Default::default(), |model| (model.model().bend, model.model().lag));
        drive::Args { place: self.place(), bend_sin: bend_sin as f32, bend_cos: bend_cos as f32, lag: lag as f32 }
    }

    fn modulate_mask(&self) -> modulate_mask::Args {
        let parts = self.parts();
        let cover = self.model.as_ref().map_or([1.0; modulate_mask::MOST], |model| model.cover());
        let here = u32::from(!parts.mask_away);
        modulate_mask::Args { place: self.place(), factor: parts.mask.max(1) as u32, here, cover }
    }

    /// Returns true if the projection keeps drives from wrapping. Crosstalk blurs the edge between the two ends of
    /// the range. A phase that jumps over it worsens the light of its neighbors, and the turns do not contain that.
    pub fn bounds_phases(&self) -> bool {
        self.variance_left() < WEAK_CROSSTALK
    }

    /// Returns the share of the variance of random drives that crosstalk leaves, 1 without crosstalk.
    pub fn variance_left(&self) -> f64 {
        self.model.as_ref().map_or(1.0, |model| model.variance_left())
    }

    /// Returns the drive that no phase exceeds, in radians, or 0 if phases wrap.
    fn bound(&self) -> f32 {
        let model = self.model.as_ref().filter(|_| self.bounds_phases());
        model.map_or(0.0, |model| model.highest_drive() as f32)
    }

    /// Makes a step down to the window, through `compare`, and up again. Pupil passes are grouped so that the windows
    /// of a group fit `in_flight` values.
    fn descend(&self, lists: impl Into<StepLists>, in_flight: usize, balanced: bool) -> Step {
        let mut step = self.empty(lists);
        // Tapered pupil passes have no edge at which pupils overlap. The caller's gain accounts for their overlap.
        let balanced = balanced && !step.is_tapered();
        step.list.extend(self.to_spectrum());
        step.list.push(Dispatch::whole(Kernel::Clear));
        let mut end = 0;
        while end < step.pupil_passes.len() {
            let pupil_passes = group(&step.pupil_passes, end, in_flight / self.frames.max(1));
            end = pupil_passes.end;
            if balanced {
                step.list.push(Dispatch { kernel: Kernel::Overlap, pupil_passes: pupil_passes.clone() });
            }
            let target =
                [Kernel::Transfer, Kernel::Relay, Kernel::Eye, Kernel::Taper, Kernel::Photograph, Kernel::Resample];
            step.over_pupil_passes(pupil_passes.clone(), &target);
            step.over_pupil_passes(pupil_passes.clone(), &THROUGH_A_WINDOW);
            step.over_pupil_passes(pupil_passes, &[Kernel::PupilAdjoint]);
        }
        if balanced {
            step.list.push(Dispatch::whole(Kernel::DivideByOverlap));
        }
        step.list.extend(self.to_field());
        // The fields of sub-pixels are checked by their result.
        let checked_last = self.parts().more_subpixels > 0;
        let check = (self.storage == Storage::F16).then_some(Dispatch::whole(Kernel::CheckFinite));
        step.list.extend(check.clone().filter(|_| !checked_last));
        step.list.extend(self.to_phases());
        step.list.extend(check.filter(|_| checked_last));
        step
    }
}

impl Step {
    /// Adds these kernels over these pupil passes, with `Taper`, `Relay`, `Eye` and `Motion` only if they have an
    /// effect.
    fn over_pupil_passes(&mut self, pupil_passes: Range<usize>, kernels: &[Kernel]) {
        let tapered = self.is_tapered();
        let relays = self.model.as_ref().is_some_and(|model| model.parts().relay > 0);
        let sees = self.pupil_passes.iter().any(|pupil_pass| pupil_pass.eye.is_some());
        let moves = self.pupil_passes.iter().any(PupilPass::moves);
        let left_out = |kernel: Kernel| match kernel {
            Kernel::Motion | Kernel::MotionBack => !moves,
            Kernel::Taper => !tapered,
            Kernel::Relay => !relays,
            Kernel::Eye => !sees,
            _ => false,
        };
        let kernels = kernels.iter().filter(|kernel| !left_out(**kernel));
        self.list.extend(kernels.map(|&kernel| Dispatch { kernel, pupil_passes: pupil_passes.clone() }));
    }

    fn is_tapered(&self) -> bool {
        self.pupil_passes.iter().any(|pupil_pass| pupil_pass.taper.is_some())
    }

    /// Returns the entry of the list after which phases may change, and before which all losses are final. It follows
    /// the last kernel that runs over pupil passes, and `check_finite` if the list has it.
    pub fn before_update(&self) -> usize {
        let known = |d: &Dispatch| d.kernel.scope().is_per_pupil() || d.kernel == Kernel::CheckFinite;
        self.list.iter().rposition(known).map_or(self.list.len(), |i| i + 1)
    }

    /// Returns the mean squared difference over the pupils, from the sums that an engine returns.
    pub fn mean_loss(&self, losses: &[f64]) -> f64 {
        mean_loss(losses, self.pupil_passes.iter().map(PupilPass::count))
    }

    /// Returns the number of entries at the start that read no pupil pass.
    pub fn shared(&self) -> usize {
        self.list.iter().take_while(|d| d.pupil_passes.is_empty()).count()
    }

    /// Reorders the list to run one pupil pass after the other, each in slot 0, because at full size one pupil pass
    /// holds as much memory as the field. After the shared entries, all pupil passes have the same number of entries.
    pub fn pass_by_pass(mut self) -> Self {
        let kernels: Vec<_> = self.list.drain(self.shared()..).map(|d| d.kernel).collect();
        for i in 0..self.pupil_passes.len() {
            self.list.extend(kernels.iter().map(|&kernel| Dispatch { kernel, pupil_passes: i..i + 1 }));
        }
        self
    }
}

/// Returns the mean squared difference over pupils, from the sums that an engine returns and the `pixels` of their
/// windows.
pub fn mean_loss(losses: &[f64], pixels: impl Iterator<Item = usize>) -> f64 {
    let each = losses.iter().zip(pixels).map(|(loss, pixels)| loss / pixels as f64);
    each.sum::<f64>() / losses.len().max(1) as f64
}

/// Returns neighboring pupil passes from `first` on, at least one, whose windows hold at most `most` values together.
fn group(pupil_passes: &[PupilPass], first: usize, most: usize) -> Range<usize> {
    let mut held = 0;
    let fits = |pass: &&PupilPass| {
        let is_first = held == 0;
        held += pass.mode_count() * pass.count();
        is_first || held <= most
    };
    first..first + pupil_passes[first..].iter().take_while(fits).count().max(1)
}
