//! Checks that the change that a step requests is finite everywhere. With fields in halves, a value may become too
//! large after the comparison, and no loss shows it there. A transform spreads a NaN or an infinity over its whole
//! frame. A check of the change after the inverse transform therefore finds the faults of all earlier kernels. All
//! sub-frames.

use crate::{Complex32, simd};

/// Returns true if no value of `change` is infinite or NaN. The slice may have any length.
pub fn check_finite(change: &[Complex32]) -> bool {
    simd(
        #[inline(always)]
        || {
            let mut found = 0u32;
            for value in bytemuck::cast_slice::<_, u32>(change) {
                found |= u32::from(value & 0x7f80_0000 == 0x7f80_0000);
            }
            found == 0
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_bad_value_is_found_wherever_it_is() {
        let mut change = vec![Complex32::new(65504.0, -3e38); 101];
        assert!(check_finite(&change));
        for (at, bad) in [(0, f32::NAN), (57, f32::INFINITY), (100, f32::NEG_INFINITY)] {
            change[at].im = bad;
            assert!(!check_finite(&change));
            change[at].im = 0.0;
        }
    }
}
