//! Keeps weights of resampling by size, because pupils return to windows of the same few sizes.

use eyebox_kernels::resample::Table;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// More sizes than all windows of a display have. A long sweep over other sizes clears the tables.
const MOST: usize = 1024;

/// Tables by the number of samples before and after.
type BySize = HashMap<(usize, usize), Arc<Table>>;

/// The tables that were used before. Clones share them.
#[derive(Debug, Clone, Default)]
pub(crate) struct ResampleTables(Arc<Mutex<BySize>>);

impl PartialEq for ResampleTables {
    /// Tables follow from their sizes, so that all collections are equal.
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl ResampleTables {
    /// Returns the table of [`Table::area`].
    pub(super) fn get(&self, n_in: usize, n_out: usize) -> Arc<Table> {
        let mut tables = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if tables.len() >= MOST {
            tables.clear();
        }
        Arc::clone(tables.entry((n_in, n_out)).or_insert_with(|| Arc::new(Table::area(n_in, n_out))))
    }
}
