//! The buffers of a shape on the device.

use super::super::layout::Layout;
use crate::engine::{Buffer, EngineError, Resource};
use crate::gpu::Block;

/// A buffer of the shape.
pub(in super::super) struct Stack {
    pub(in super::super) layout: Layout,
    pub(in super::super) block: Block,
}

/// The buffers of the shape, those that its purpose needs, in the order of [`Resource::OF_SHAPE`].
#[derive(Default)]
pub(in super::super) struct Stacks(pub(in super::super) [Option<Stack>; Resource::OF_SHAPE.len()]);

impl Stacks {
    pub(in super::super) fn get(&self, buffer: Buffer) -> Result<&Stack, EngineError> {
        let missing = || EngineError::Mismatch { reason: format!("{buffer:?} is not made for this purpose") };
        self.find(buffer.resource().0).ok_or_else(missing)
    }

    pub(super) fn find(&self, resource: Resource) -> Option<&Stack> {
        Resource::OF_SHAPE.iter().position(|r| *r == resource).and_then(|at| self.0[at].as_ref())
    }
}
