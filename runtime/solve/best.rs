//! The best state of a refinement: refinement for one pupil can get worse again, and its last state is not the best.

/// Pupils around the eye through which states are judged, other than those that steps draw.
pub const JUDGED_PUPILS: usize = 12;

/// Whether the state after a step is judged: after steps 1, 2, 4, 8, ..., and the last.
///
/// Looking through pupils takes about as long as a step, so states in between are not judged.
pub fn is_judged(step: usize, steps: usize) -> bool {
    step.is_power_of_two() || step == steps
}

/// The best state so far.
#[derive(Debug, Clone, PartialEq)]
pub struct BestState<T> {
    /// The step after which it was reached; 0 for the state before the first.
    pub step: usize,
    /// Mean PSNR of the judged pupils, dB.
    pub psnr: f64,
    /// The state, such as phases.
    pub state: T,
}

impl<T> BestState<T> {
    /// Takes over the state of a step if it is better.
    ///
    /// # Errors
    /// Those of `state`.
    pub fn offer<E>(&mut self, step: usize, psnr: f64, state: impl FnOnce() -> Result<T, E>) -> Result<(), E> {
        if psnr > self.psnr {
            *self = Self { step, psnr, state: state()? };
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_worse_state_is_not_taken() {
        let mut best = BestState { step: 0, psnr: 18.0, state: 'a' };
        for (step, psnr, state) in [(1, 17.0, 'b'), (8, 20.95, 'c'), (16, 19.9, 'd'), (32, f64::NAN, 'e')] {
            best.offer(step, psnr, || Ok::<_, ()>(state)).unwrap();
        }
        assert_eq!(best, BestState { step: 8, psnr: 20.95, state: 'c' });
        assert_eq!((1..=20).filter(|step| is_judged(*step, 20)).collect::<Vec<_>>(), [1, 2, 4, 8, 16, 20]);
    }
}
