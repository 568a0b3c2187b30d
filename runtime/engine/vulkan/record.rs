//! From an entry of the list to dispatches.

mod call;
mod fused;
mod fused_grid;
mod fused_windows;
mod hazards;
mod photograph;
mod shaders;
mod single;
mod stacks;

use super::layout::Slot;
use crate::engine::{Dispatch, EngineError, Kernel};
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
        call.work.before(kernel.binds());
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
}
