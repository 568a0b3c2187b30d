//! Decides which entries of a list are recorded together, as one fused kernel.
//!
//! A fused kernel reads and writes only once the values that its entries pass on to each other. The list still
//! defines the computation, and its single kernels are the reference for the fused ones. Entries are fused if they
//! are neighbors around a transform whose lines go through shared memory. The entry before the transform is computed
//! where values are fetched, and the entry after it where they are stored. The CPU engine has no twins of fused
//! kernels, because it runs neighbors of the list depth first.

use super::lists::THROUGH_A_WINDOW;
use super::{Dispatch, Kernel, Step};

/// [`THROUGH_A_WINDOW`] for eyes that do not move.
const THROUGH_A_STILL_WINDOW: [Kernel; 6] = {
    let [pass, _, inverse, intensity, compare, factor, forward, _] = THROUGH_A_WINDOW;
    [pass, inverse, intensity, compare, factor, forward]
};

/// Largest number of pupils whose changes one kernel can gather.
const MOST_GATHERED: usize = 64;

/// How an entry of a list is recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fusion {
    /// It has a kernel of its own.
    Alone,
    /// Another entry's kernel does its work.
    Elsewhere,
    /// The fusion of `modulate` and `field_forward`.
    FieldFromPhases,
    /// `drive`, `lag` and crosstalk, as far as the model has them.
    DriveTiles,
    /// The fusion of `modulate_wave` and `field_forward`.
    FieldFromWave,
    /// From `pass_pupil` to `intensity`.
    See,
    /// From `pass_pupil` to `window_forward`.
    ThroughWindows,
    /// `pupil_adjoint` and the overlap. The last pupils also take `divide_by_overlap` and the columns of
    /// `change_inverse`.
    Gather {
        /// True if other pupils were gathered before.
        adds: bool,
        /// True if these pupils are the last.
        last: bool,
    },
    /// The rows of `change_inverse`.
    ChangeRows,
    /// The rows of `change_inverse` with the epilogue. They run at the entry of the epilogue, because losses are
    /// judged before it.
    ChangeRowsAnd(Epilogue),
    /// `change_inverse` with the columns before, and the epilogue.
    ChangeAnd(Epilogue),
    /// The adjoints of crosstalk and lag that the model has, `drive_adjoint`, and `project` at its entry.
    ProjectTiles,
}

/// The kernel that runs where rows of the change are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Epilogue {
    /// The kernel is `project`.
    Project,
    /// The kernel is `adam`.
    Adam,
    /// The kernel is `phase_gradient`.
    PhaseGradient,
}

impl Epilogue {
    fn of(kernel: Kernel) -> Option<Self> {
        match kernel {
            Kernel::Project => Some(Self::Project),
            Kernel::Adam => Some(Self::Adam),
            Kernel::PhaseGradient => Some(Self::PhaseGradient),
            _ => None,
        }
    }
}

/// The fusions of a step that a device supports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Fusable {
    /// Transforms of the grid are fused.
    pub grid: bool,
    /// Transforms of the windows of all pupils are fused.
    pub windows: bool,
    /// The windows of a group are in one range, and so are their propagation kernels.
    pub gather: bool,
    /// A display's model and its adjoint run on all sub-frames of a tile of pixels with its surroundings.
    pub tiles: bool,
}

/// Returns one fusion for each of these entries of the step's list.
pub(crate) fn ways(step: &Step, list: &[&Dispatch], fusable: Fusable) -> Vec<Fusion> {
    let mut ways = vec![Fusion::Alone; list.len()];
    // With several modes, the image is complete only when all of them have passed.
    let one_mode = step.pupil_passes.iter().all(|pass| pass.modes.is_empty());
    let fusable = Fusable { windows: fusable.windows && one_mode, gather: fusable.gather && one_mode, ..fusable };
    let (driven, back) = of_tiles(step);
    // `See` leaves no retinal field, so no later entry may need it.
    let ends_there = step.list.iter().all(|d| d.kernel != Kernel::ApplyFactor);
    for at in 0..list.len() {
        let here = |kernels: &[Kernel]| runs(&list[at..], kernels);
        let (way, count) = if ways[at] != Fusion::Alone {
            continue;
        } else if fusable.grid && here(&[Kernel::Modulate, Kernel::FieldForward]) {
            (Fusion::FieldFromPhases, 2)
        } else if fusable.tiles && here(&driven) {
            (Fusion::DriveTiles, driven.len())
        } else if fusable.grid && here(&[Kernel::ModulateWave, Kernel::FieldForward]) {
            (Fusion::FieldFromWave, 2)
        } else if fusable.windows && here(&THROUGH_A_STILL_WINDOW) {
            (Fusion::ThroughWindows, THROUGH_A_STILL_WINDOW.len())
        } else if fusable.windows && ends_there && here(&THROUGH_A_STILL_WINDOW[..3]) {
            (Fusion::See, 3)
        } else {
            continue;
        };
        ways[at..at + count].fill(Fusion::Elsewhere);
        ways[at] = way;
    }
    if fusable.tiles {
        project_tiles(&back, list, &mut ways);
    }
    let Some(inverse) = list.iter().position(|d| d.kernel == Kernel::ChangeInverse).filter(|_| fusable.grid) else {
        return ways;
    };
    let gathers = fusable.gather && gather(step, list, inverse, &mut ways);
    // The check of the change takes place where it is gathered and stored.
    let checks = list.get(inverse + 1).is_some_and(|d| d.kernel == Kernel::CheckFinite);
    let behind = inverse + 1 + usize::from(checks);
    match list.get(behind).and_then(|d| Epilogue::of(d.kernel)) {
        Some(kernel) if gathers || !checks => {
            ways[inverse..behind].fill(Fusion::Elsewhere);
            ways[behind] = if gathers { Fusion::ChangeRowsAnd(kernel) } else { Fusion::ChangeAnd(kernel) };
        }
        _ if gathers => ways[inverse] = Fusion::ChangeRows,
        _ => {}
    }
    ways
}

/// Returns true if the list starts with these kernels, over the same pupil passes.
fn runs(list: &[&Dispatch], kernels: &[Kernel]) -> bool {
    list.len() >= kernels.len()
        && list.iter().zip(kernels).all(|(d, kernel)| d.kernel == *kernel && d.pupil_passes == list[0].pupil_passes)
}

/// Returns the kernels from phases to the model's result, and the kernels from there back up to `project`.
fn of_tiles(step: &Step) -> (Vec<Kernel>, Vec<Kernel>) {
    use Kernel::{CrosstalkColumns, CrosstalkColumnsBack, CrosstalkRows, CrosstalkRowsBack};
    let lags = step.drive.lag > 0.0;
    let blurs = step.model.as_ref().is_some_and(|model| model.parts().crosstalk.is_some());
    let mut driven = vec![Kernel::Drive];
    driven.extend(lags.then_some(Kernel::Lag));
    driven.extend(blurs.then_some([CrosstalkRows, CrosstalkColumns]).into_iter().flatten());
    let mut back: Vec<_> = blurs.then_some([CrosstalkColumnsBack, CrosstalkRowsBack]).into_iter().flatten().collect();
    back.extend(lags.then_some(Kernel::LagAdjoint));
    back.extend([Kernel::DriveAdjoint, Kernel::Project]);
    (driven, back)
}

/// Fuses the adjoint of a display's model up to `project`, if this part of the list has all of it.
fn project_tiles(back: &[Kernel], list: &[&Dispatch], ways: &mut [Fusion]) {
    let Some(project) = list.iter().position(|d| d.kernel == Kernel::Project) else { return };
    let Some(first) = (project + 1).checked_sub(back.len()) else { return };
    if runs(&list[first..], back) {
        ways[first..project].fill(Fusion::Elsewhere);
        ways[project] = Fusion::ProjectTiles;
    }
}

/// Fuses the return to the spectrum, and returns true if it did. This part must hold all entries up to the field's
/// change at entry `inverse`, because no buffer holds the values in between.
fn gather(step: &Step, list: &[&Dispatch], inverse: usize, ways: &mut [Fusion]) -> bool {
    let Some(end) = list.iter().rposition(|d| d.kernel == Kernel::PupilAdjoint) else { return false };
    let divides = end + 1 < inverse && list[end + 1].kernel == Kernel::DivideByOverlap;
    let adjacent = inverse == end + 1 + usize::from(divides);
    if !adjacent || step.pupil_passes.len() > MOST_GATHERED {
        return false;
    }
    for at in 0..inverse {
        match list[at].kernel {
            Kernel::Clear | Kernel::Overlap | Kernel::DivideByOverlap => ways[at] = Fusion::Elsewhere,
            Kernel::PupilAdjoint => {
                ways[at] = Fusion::Gather { adds: list[at].pupil_passes.start > 0, last: at == end };
            }
            _ => {}
        }
    }
    true
}

/// Returns true if the step divides by the overlap.
pub(crate) fn divides(step: &Step) -> bool {
    step.list.iter().any(|d| d.kernel == Kernel::DivideByOverlap)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::{DisplayModel, Optics, Pupil, Spread, WindowFactor};
    use crate::plan::{Comparison, ModelTables, Planner};

    const ALL: Fusable = Fusable { grid: true, windows: true, gather: true, tiles: true };

    fn planner() -> Planner {
        let optics = Optics::new(40, 64, 8e-6, 520e-9, 0.4).unwrap();
        Planner::new(optics, 2, WindowFactor::Two)
    }

    /// Returns a step of two pupils, in one group or in two.
    fn step(in_flight: usize) -> Step {
        let pupil = |x| Pupil { x, y: 0.0, diameter: 4e-3, depth: 1e-3 };
        let passes = [0.0, 2e-3].map(|x| planner().pupil_pass(&pupil(x), &Comparison::default()));
        planner().project_step(passes.to_vec(), in_flight, 0.5, 1.0, 0.0)
    }

    /// Returns the kernels that carry a fusion, with that fusion.
    fn carried(step: &Step, entries: std::ops::Range<usize>, fusable: Fusable) -> Vec<(Kernel, Fusion)> {
        let list: Vec<&Dispatch> = step.list[entries].iter().collect();
        let ways = ways(step, &list, fusable);
        list.iter().zip(ways).filter(|(_, way)| *way != Fusion::Elsewhere).map(|(d, way)| (d.kernel, way)).collect()
    }

    #[test]
    fn a_whole_step_is_six_entries_beside_photographs() {
        let step = step(usize::MAX);
        let got = carried(&step, 0..step.list.len(), ALL);
        let alone = |kernel| (kernel, Fusion::Alone);
        let want = [
            (Kernel::Modulate, Fusion::FieldFromPhases),
            alone(Kernel::Transfer),
            alone(Kernel::Photograph),
            alone(Kernel::Resample),
            (Kernel::PassPupil, Fusion::ThroughWindows),
            (Kernel::PupilAdjoint, Fusion::Gather { adds: false, last: true }),
            (Kernel::Project, Fusion::ChangeRowsAnd(Epilogue::Project)),
        ];
        assert_eq!(got, want);
        // A device that fuses nothing runs the list unchanged.
        assert!(carried(&step, 0..step.list.len(), Fusable::default()).iter().all(|(_, way)| *way == Fusion::Alone));
    }

    /// Adam's last kernel fuses like the projection's. If another entry is between the pupils and the field's change,
    /// the last kernel takes both axes of the transform.
    #[test]
    fn the_last_kernels_of_other_lists_are_fused() {
        let last = |step: &Step| carried(step, 0..step.list.len(), ALL).pop().unwrap();
        let adam = planner().adam_step(step(1).pupil_passes, 1, 1, 0.1);
        assert_eq!(last(&adam), (Kernel::Adam, Fusion::ChangeRowsAnd(Epilogue::Adam)));
        let even = planner().with_equalised_eyebox(step(1), 8e-3, 4, 0.5);
        assert_eq!(last(&even), (Kernel::Project, Fusion::ChangeAnd(Epilogue::Project)));
        let carried = carried(&even, 0..even.list.len(), ALL);
        assert!(carried.contains(&(Kernel::PupilAdjoint, Fusion::Alone)), "{carried:?}");
    }

    /// The parts of a display's model that act on pixels are one entry on the way there and one on the way back.
    #[test]
    fn a_model_is_two_entries_and_two_in_their_transforms() {
        let mut planner = planner();
        let terms =
            DisplayModel { lag: 0.1, crosstalk: Some([Spread { q: 1.2, sigma: 2.0 }; 4]), ..Default::default() };
        planner.model = ModelTables::new(terms, 11e-3, 256, planner.slm, planner.grid);
        let pass = planner.pupil_pass(&Pupil { x: 0.0, y: 0.0, diameter: 4e-3, depth: 1e-3 }, &Comparison::default());
        let step = planner.project_step(vec![pass], 1, 0.5, 1.0, 0.0);
        let ways: Vec<_> = carried(&step, 0..step.list.len(), ALL).into_iter().map(|(_, way)| way).collect();
        let ways: Vec<_> = ways.into_iter().filter(|way| *way != Fusion::Alone).collect();
        let gather = Fusion::Gather { adds: false, last: true };
        let back = Fusion::ChangeRowsAnd(Epilogue::PhaseGradient);
        let want =
            [Fusion::DriveTiles, Fusion::FieldFromWave, Fusion::ThroughWindows, gather, back, Fusion::ProjectTiles];
        assert_eq!(ways, want);
        // Without tiles, the entries stay single.
        let singly = carried(&step, 0..step.list.len(), Fusable { tiles: false, ..ALL });
        assert!(
            [Kernel::Lag, Kernel::CrosstalkRowsBack, Kernel::Project]
                .map(|k| singly.contains(&(k, Fusion::Alone)))
                .iter()
                .all(|x| *x)
        );
    }

    #[test]
    fn groups_add_to_each_other_and_what_is_cut_is_not_fused() {
        let step = step(1);
        let gathers = |entries| {
            let carried = carried(&step, entries, ALL).into_iter();
            carried.filter(|(_, way)| matches!(way, Fusion::Gather { .. })).map(|(_, way)| way).collect::<Vec<_>>()
        };
        let (first, last) = (Fusion::Gather { adds: false, last: false }, Fusion::Gather { adds: true, last: true });
        assert_eq!(gathers(0..step.list.len()), [first, last]);
        let at = |kernel| step.list.iter().rposition(|d| d.kernel == kernel).unwrap();
        assert_eq!(gathers(0..at(Kernel::PupilAdjoint)), []);
        assert_eq!(gathers(0..at(Kernel::ChangeInverse)), []);
        assert_eq!(gathers(at(Kernel::PupilAdjoint)..step.list.len()), [last]);
        // The retinal field remains for the entries after it.
        let seen = carried(&step, 0..at(Kernel::Compare), ALL);
        assert!(seen.contains(&(Kernel::Intensity, Fusion::Alone)), "{seen:?}");
        // A list that only views needs no retinal field.
        let view = planner().view_step(step.pupil_passes.clone());
        assert!(carried(&view, 0..view.list.len(), ALL).contains(&(Kernel::PassPupil, Fusion::See)));
    }
}
