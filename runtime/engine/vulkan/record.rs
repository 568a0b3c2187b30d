//! From an entry of the list to dispatches.

mod batches;
mod call;
mod fused;
mod fused_grid;
mod fused_windows;
mod hazards;
mod shaders;
mod single;
mod stacks;

use super::layout::Slot;
use crate::engine::{Dispatch, EngineError, Kernel, Resource};
use crate::plan::Access;
use crate::plan::fusion::Way;
use call::Call;
pub(super) use call::Work;
pub(super) use hazards::Hazards;
use shaders::{Shader, shader};
pub(super) use stacks::{Stack, Stacks};

impl Work<'_> {
    /// Makes the plans and tables of all transforms in these entries.
    pub(super) fn prepare(&mut self, list: &[&Dispatch]) -> Result<(), EngineError> {
        let grid = [self.shape.place.grid_height as usize, self.shape.place.grid_width as usize];
        let storage = self.shape.storage;
        for dispatch in list {
            match dispatch.kernel {
                Kernel::FieldForward | Kernel::ChangeInverse => self.transforms.prepare(self.gpu, grid, storage)?,
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

    /// Records one entry of the list, and what is fused with it, behind the barriers that it needs.
    pub(super) fn record(&mut self, dispatch: &Dispatch, way: Way, slots: &[Slot]) -> Result<(), EngineError> {
        let (step, shape, kernel) = (self.step, self.shape, dispatch.kernel);
        let (shader, module) = shader(kernel);
        let mut call = Call { work: self, step, shape, kernel, module, dispatch, slots, at: 0 };
        if way != Way::Alone {
            return call.fused(way);
        }
        let mut binds = kernel.binds().to_vec();
        if kernel.writes().any(|resource| resource == Resource::Phases) {
            binds.push((Access::Read, Resource::Losses));
        }
        call.work.before(&binds);
        let shader = match shader {
            Shader::Once(shader) => return shader(&mut call),
            Shader::Each(shader) => shader,
        };
        for (at, pass) in step.pupil_passes[dispatch.pupil_passes.clone()].iter().enumerate() {
            if at > 0 && kernel.accumulates_over_pupils() {
                call.work.gpu.recorder.barrier();
            }
            call.at = at;
            shader(&mut call, pass)?;
        }
        Ok(())
    }

    /// Records what losses, which end at `end`, and the verdict over them start from; `clear`: one that was bad is forgotten.
    pub(super) fn prepare_verdict(&mut self, end: u64, clear: bool) {
        let Some((losses, _)) = self.losses else { return };
        // What a kernel leaves no loss in adds none.
        self.gpu.recorder.clear(losses.range(0, end));
        let Some(guarded) = &self.guarded else { return };
        let to = guarded.verdict.groups();
        self.gpu.recorder.copy(guarded.groups, to.block, [(0, to.offset, to.size)]);
        if clear {
            self.gpu.recorder.clear(guarded.verdict.flag());
        }
    }

    /// Judges the losses, once, if phases depend on it. Whatever changes phases comes behind it.
    pub(super) fn judge(&mut self, end: u64) -> Result<(), EngineError> {
        let (Some(guarded), Some((losses, _))) = (&mut self.guarded, self.losses) else { return Ok(()) };
        if std::mem::replace(&mut guarded.is_judged, true) {
            return Ok(());
        }
        let (flag, groups) = (guarded.verdict.flag(), guarded.verdict.groups());
        // The verdict goes with the losses: who waits for the one waits for the other.
        self.before(&[(Access::Update, Resource::Losses), (Access::Read, Resource::NotFinite)]);
        let push = [end as u32 / 4, groups.size as u32 / 4];
        let pipeline = self.gpu.pipeline(&eyebox_spirv::JUDGE, 3, &[])?;
        let buffers = [losses.range(0, end), flag, groups];
        self.gpu.recorder.dispatch(pipeline, &buffers, bytemuck::cast_slice(&push), [1, 1, 1])?;
        self.gpu.recorder.moved(|| vec![buffers[0].reads(end), groups.writes(0)]);
        Ok(())
    }
}
