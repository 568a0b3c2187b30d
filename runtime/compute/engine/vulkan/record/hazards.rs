//! Where barriers go: before what meets something that was written, or will be, since the last one.

use crate::engine::{Resource, Shape};
use crate::plan::Access;

/// What runs side by side since the last barrier reads and writes.
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
    /// Adds what is to run; whether it has to wait for what runs.
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
