//! Chooses the light of a refinement, which comes from the display's lit switchable sources.

use super::Refiner;
use crate::optics::{Pupil, SourceChoice};

impl Refiner {
    /// Returns the indices of the lit switchable sources. The list is empty if there are none, or if they do not follow
    /// the eye.
    pub fn sources(&self) -> &[usize] {
        self.problem.choice.as_ref().map_or(&[], |choice| choice.lit())
    }

    /// Returns the share of a pupil that these sources (indices) serve, or 1 without sources.
    pub fn served(&self, lit: &[usize], pupil: &Pupil) -> f64 {
        self.problem.choice.as_ref().map_or(1.0, |choice| choice.served(lit, pupil))
    }

    /// Lights these switchable sources (indices) until the next [aim](Self::aim). The drawn pupils are dropped because
    /// they belong to the old sources.
    pub fn light(&mut self, sources: &[usize]) {
        self.planner.light(sources);
        self.drawing.forget();
    }

    /// Chooses the sources for the position of the eye. It returns true if they changed.
    pub(super) fn choose_sources(&mut self) -> bool {
        let aim = self.aim;
        self.choose(|choice| choice.follow(&aim))
    }

    /// Lights the sources for an unknown position of the eye, until the next aim.
    pub fn forget_sources(&mut self) {
        self.choose(|choice| {
            choice.forget();
            true
        });
    }

    fn choose(&mut self, change: impl FnOnce(&mut SourceChoice) -> bool) -> bool {
        let Some(choice) = &mut self.problem.choice else { return false };
        if !change(choice) {
            return false;
        }
        let (lit, regions) = (choice.lit().to_vec(), choice.regions());
        self.problem.regions = regions.into();
        self.light(&lit);
        true
    }
}
