//! Decides on barriers between conflicting reads and writes.
//!
//! A barrier precedes an access to a resource that was written since the last one, or a write to one that was read.

use crate::engine::{Resource, Shape};
use crate::plan::Access;

/// Reads and writes since the last barrier.
pub(in super::super) struct Hazards {
    read: Vec<Resource>,
    written: Vec<Resource>,
}

impl Default for Hazards {
    /// At the start of a recording the tables have been copied, and losses cleared.
    fn default() -> Self {
        use Resource::{ColumnWeights, EyeTerms, Losses, Moments, NotFinite, RowWeights, Spans, TaperWeights, Taps};
        let tables = [Spans, EyeTerms, TaperWeights, Moments, Taps, RowWeights, ColumnWeights];
        let written = [&tables[..], &[Losses, NotFinite]].concat();
        Self { read: Vec::new(), written }
    }
}

impl Hazards {
    /// Adds the next bindings. Returns true if they have to wait for running work.
    pub(super) fn meets(&mut self, binds: &[(Access, Resource)], shape: &Shape) -> bool {
        let binds = binds.iter().map(|(access, resource)| (*access != Access::Read, shape.alias(*resource)));
        let meets = binds.clone().any(|(writes, r)| self.written.contains(&r) || (writes && self.read.contains(&r)));
        if meets {
            self.read.clear();
            self.written.clear();
        }
        for (writes, resource) in binds {
            if writes { &mut self.written } else { &mut self.read }.push(resource);
        }
        meets
    }
}
