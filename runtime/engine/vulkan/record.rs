//! From an entry of the list to dispatches.

mod call;
mod photograph;
mod shaders;
mod single;
mod stacks;

use super::layout::Slot;
use crate::engine::{Dispatch, EngineError, Kernel};
use call::Call;
pub(super) use call::Work;
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

    /// Records one entry of the list; the caller sets the barriers around it.
    pub(super) fn record(&mut self, dispatch: &Dispatch, slots: &[Slot]) -> Result<(), EngineError> {
        let (step, shape, kernel) = (self.step, self.shape, dispatch.kernel);
        let (shader, module) = shader(kernel);
        let mut call = Call { work: self, step, shape, kernel, module, dispatch, slots, at: 0 };
        let shader = match shader {
            Shader::Once(shader) => return shader(&mut call),
            Shader::Each(shader) => shader,
        };
        for (at, pass) in step.pupil_passes[dispatch.pupil_passes.clone()].iter().enumerate() {
            if kernel.accumulates_over_pupils() {
                call.work.gpu.recorder.barrier();
            }
            call.at = at;
            shader(&mut call, pass)?;
        }
        Ok(())
    }

    /// Records what the verdict over losses that end at `end` starts from; `clear`: one that was bad is forgotten. A barrier
    /// must follow.
    pub(super) fn prepare_verdict(&mut self, end: u64, clear: bool) {
        let (Some(guarded), Some((losses, _))) = (&self.guarded, self.losses) else { return };
        let to = guarded.verdict.groups();
        self.gpu.recorder.clear(losses.range(0, end));
        self.gpu.recorder.copy(guarded.groups, to.block, [(0, to.offset, to.size)]);
        if clear {
            self.gpu.recorder.clear(guarded.verdict.flag());
        }
    }

    /// Judges the losses, once, if phases depend on it; `at_once`: by the very next dispatch. Whatever changes phases comes
    /// behind it.
    pub(super) fn judge(&mut self, end: u64, at_once: bool) -> Result<(), EngineError> {
        let (Some(guarded), Some((losses, _))) = (&mut self.guarded, self.losses) else { return Ok(()) };
        if std::mem::replace(&mut guarded.is_judged, true) {
            return Ok(());
        }
        let (flag, groups) = (guarded.verdict.flag(), guarded.verdict.groups());
        let push = [end as u32 / 4, groups.size as u32 / 4];
        let pipeline = self.gpu.pipeline(&eyebox_spirv::JUDGE, 3, &[])?;
        let buffers = [losses.range(0, end), flag, groups];
        self.gpu.recorder.dispatch(pipeline, &buffers, bytemuck::cast_slice(&push), [1, 1, 1])?;
        self.gpu.recorder.moved(|| vec![buffers[0].reads(end), groups.writes(0)]);
        if at_once {
            self.gpu.recorder.barrier();
        }
        Ok(())
    }
}
