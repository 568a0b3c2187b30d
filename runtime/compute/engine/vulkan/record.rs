//! Records an entry of the list as dispatches.

mod batches;
mod call;
mod fused;
mod fused_grid;
mod fused_windows;
mod hazards;
mod shaders;
mod single;
mod stacks;
mod waves;

use super::flight::PLACE;
use super::layout::Slot;
use crate::engine::{Dispatch, EngineError, Kernel, Resource};
use crate::gpu::Groups;
use crate::plan::Access;
use crate::plan::fusion::Fusion;
use call::Call;
pub(super) use call::Work;
pub(super) use hazards::Hazards;
use shaders::{Shader, shader};
pub(super) use stacks::{Stack, Stacks};

impl<'a> Work<'a> {
    /// Makes the plans and tables of all transforms in these entries.
    pub(super) fn prepare(&mut self, list: &[&Dispatch]) -> Result<(), EngineError> {
        let grid = [self.shape.place.grid_height as usize, self.shape.place.grid_width as usize];
        let storage = self.shape.storage;
        for dispatch in list {
            match dispatch.kernel {
                Kernel::FieldForward
                | Kernel::ChangeInverse
                | Kernel::SubpixelsForward
                | Kernel::SubpixelsInverse
                | Kernel::ToMask
                | Kernel::FromMask => self.transforms.prepare(self.gpu, grid, storage)?,
                Kernel::WindowForward | Kernel::WindowInverse => {
                    for pass in &self.step.pupil_passes[dispatch.pupil_passes.clone()] {
                        self.transforms.prepare(self.gpu, [pass.window.rows, pass.window.columns], storage)?;
                    }
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Records one entry of the list and the entries fused with it, after the barriers that it needs.
    pub(super) fn record(&mut self, dispatch: &Dispatch, way: Fusion, slots: &[Slot]) -> Result<(), EngineError> {
        let (step, shape, kernel) = (self.step, self.shape, dispatch.kernel);
        let (shader, module) = shader(kernel);
        let mut call = Call { work: self, step, shape, kernel, module, dispatch, slots, at: 0, mode: 0 };
        if way != Fusion::Alone {
            return call.fused(way);
        }
        let mut binds = kernel.binds().to_vec();
        if kernel.writes().any(|resource| resource == Resource::Phases) {
            binds.push((Access::Read, Resource::Losses));
        }
        call.work.before(&binds);
        let (shader, all_modes) = match shader {
            Shader::Once(shader) => return shader(&mut call),
            Shader::Each(shader) => (shader, false),
            Shader::Modes(shader) => (shader, true),
        };
        for (at, pass) in step.pupil_passes[dispatch.pupil_passes.clone()].iter().enumerate() {
            let modes = if all_modes { pass.mode_count() } else { 1 };
            for mode in 0..modes {
                // All modes of a pupil add to its image.
                let adds = kernel.accumulates_over_pupils() || (mode > 0 && kernel == Kernel::Intensity);
                if at + mode > 0 && adds {
                    call.work.gpu.recorder.barrier();
                }
                (call.at, call.mode) = (at, mode);
                shader(&mut call, pass.mode(mode))?;
            }
        }
        Ok(())
    }

    /// Records the initial state of the losses, which end at `end`, and of the verdict. With `clear`, a bad verdict
    /// is deleted.
    pub(super) fn prepare_verdict(&mut self, end: u64, clear: bool) {
        let Some((losses, _)) = self.losses else { return };
        // The sums of a kernel that leaves no loss are zero.
        self.gpu.recorder.clear(losses.range(0, end));
        let Some(guarded) = &self.guarded else { return };
        let to = guarded.verdict.groups();
        self.gpu.recorder.copy(guarded.groups, to.block, [(0, to.offset, to.size)]);
        if clear {
            self.gpu.recorder.clear(guarded.verdict.flag());
        }
    }

    /// Judges the losses once, if phases depend on it. All changes of phases follow it.
    pub(super) fn judge(&mut self, end: u64) -> Result<(), EngineError> {
        let (Some(guarded), Some(_)) = (&mut self.guarded, self.losses) else { return Ok(()) };
        if std::mem::replace(&mut guarded.is_judged, true) {
            return Ok(());
        }
        self.copy_groups()?;
        // The verdict counts as part of the losses, so that a wait for the losses is also a wait for the verdict.
        self.before(&[(Access::Update, Resource::Losses), (Access::Read, Resource::NotFinite)]);
        self.judge_groups(end)
    }

    /// Copies the workgroups again if this is another part of the list than at the last copy, and returns true if it
    /// is. The host writes the workgroups while it records. The next dispatch is in this part.
    fn copy_groups(&mut self) -> Result<bool, EngineError> {
        let part = self.gpu.recorder.hold_part()?;
        let Some(guarded) = &mut self.guarded else { return Ok(false) };
        if std::mem::replace(&mut guarded.part, part) == part {
            return Ok(false);
        }
        let to = guarded.verdict.groups();
        self.gpu.recorder.barrier();
        self.gpu.recorder.copy(guarded.groups, to.block, [(0, to.offset, to.size)]);
        self.gpu.recorder.barrier();
        Ok(true)
    }

    fn judge_groups(&mut self, end: u64) -> Result<(), EngineError> {
        let (Some(guarded), Some((losses, _))) = (&self.guarded, self.losses) else { return Ok(()) };
        let (flag, groups) = (guarded.verdict.flag(), guarded.verdict.groups());
        let push = [end as u32 / 4, groups.size as u32 / 4];
        let pipeline = self.gpu.pipeline(&eyebox_spirv::JUDGE, 3, &[])?;
        let buffers = [losses.range(0, end), flag, groups];
        self.gpu.recorder.dispatch(pipeline, &buffers, bytemuck::cast_slice(&push), [1, 1, 1])?;
        self.gpu.recorder.moved(|| vec![buffers[0].reads(end), groups.writes(0)]);
        Ok(())
    }

    /// Returns these workgroups. A dispatch that changes phases has none if losses are not finite.
    pub(super) fn guarded(&mut self, groups: [u32; 3], changes_phases: bool) -> Result<Groups<'a>, EngineError> {
        if !changes_phases || self.guarded.is_none() {
            return Ok(Groups::These(groups));
        }
        if self.copy_groups()? {
            // The verdict of an earlier part also holds for these workgroups.
            self.judge_groups(PLACE)?;
            self.gpu.recorder.barrier();
            self.gpu.recorder.is_held = true;
        }
        let full = || EngineError::mismatch("phases change before losses are judged, or in too many dispatches");
        self.guarded.as_mut().and_then(|guarded| guarded.groups(groups)).ok_or_else(full)
    }
}
