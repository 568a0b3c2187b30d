//! Weights of resampling, kept by their sizes: pupils come again and again to windows of the same few.

use eyebox_kernels::resample::Table;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// More sizes than all windows of a display have: what a long sweep over others leaves is forgotten.
const MOST: usize = 1024;

/// Tables by how many samples go in and come out.
type BySize = HashMap<(usize, usize), Arc<Table>>;

/// Those that were asked for; clones share them.
#[derive(Debug, Clone, Default)]
pub(crate) struct ResampleTables(Arc<Mutex<BySize>>);

impl PartialEq for ResampleTables {
    /// What is kept follows from its sizes.
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl ResampleTables {
    /// [`Table::area`].
    pub(super) fn get(&self, n_in: usize, n_out: usize) -> Arc<Table> {
        let mut tables = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if tables.len() >= MOST {
            tables.clear();
        }
        Arc::clone(tables.entry((n_in, n_out)).or_insert_with(|| Arc::new(Table::area(n_in, n_out))))
    }
}
