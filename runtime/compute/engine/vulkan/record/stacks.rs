//! Holds the buffers of a shape on the device.

use super::super::layout::Layout;
use crate::engine::{Buffer, EngineError, ModelTables, Resource, misfit};
use crate::gpu::{Block, Commands};
use std::sync::Arc;

/// A buffer of the shape.
pub(in super::super) struct Stack {
    pub(in super::super) layout: Layout,
    pub(in super::super) block: Block,
}

/// The buffers of the shape that its purpose needs, in the order of [`Resource::OF_SHAPE`].
#[derive(Default)]
pub(in super::super) struct Stacks(
    pub(in super::super) [Option<Stack>; Resource::OF_SHAPE.len()],
    /// The display's model whose tables they hold.
    Option<Arc<ModelTables>>,
);

impl Stacks {
    /// Fills the tables of a display's model, unless they already hold it.
    pub(in super::super) fn hold(
        &mut self,
        gpu: &mut Commands,
        model: Option<&Arc<ModelTables>>,
    ) -> Result<(), EngineError> {
        let Some(model) = model.filter(|m| self.1.as_ref().is_none_or(|had| !Arc::ptr_eq(had, m))) else {
            return Ok(());
        };
        for (buffer, table) in model.buffers() {
            let Stack { layout, block } = self.get(buffer)?;
            if layout.floats() != table.len() {
                return Err(misfit(buffer, layout.floats(), table.len()));
            }
            layout.write(gpu, block, table)?;
        }
        self.1 = Some(Arc::clone(model));
        Ok(())
    }

    pub(in super::super) fn get(&self, buffer: Buffer) -> Result<&Stack, EngineError> {
        let missing = || EngineError::mismatch(format!("{buffer:?} does not exist for this purpose"));
        self.find(buffer.resource().0).ok_or_else(missing)
    }

    pub(super) fn find(&self, resource: Resource) -> Option<&Stack> {
        Resource::OF_SHAPE.iter().position(|r| *r == resource).and_then(|at| self.0[at].as_ref())
    }
}
