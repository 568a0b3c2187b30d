//! Whether what a step asks of the phases is finite everywhere: where fields are stored as halves, a value may become
//! too large for them behind the comparison, where no loss shows it. A transform spreads what is no number over its whole
//! frame, so that looking at the change, transformed back, finds what any kernel before it did. All sub-frames.

use crate::{Complex32, simd};

/// `change` (any number of values). True if none is infinite or NaN.
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
