//! The light that the pupils of a refinement's steps see: that of the display's sources that are switched on.

use super::Refiner;
use crate::optics::{Pupil, SourceChoice};

impl Refiner {
    /// The display's switchable sources that are lit, by their places; none where it has none, or they are not steered.
    pub fn sources(&self) -> &[usize] {
        self.problem.choice.as_ref().map_or(&[], |choice| choice.lit())
    }

    /// Share of a pupil that these sources of the display serve, by their places; 1 where it has none.
    pub fn served(&self, lit: &[usize], pupil: &Pupil) -> f64 {
        self.problem.choice.as_ref().map_or(1.0, |choice| choice.served(lit, pupil))
    }

    /// Lights these of the display's switchable sources, by their places, until it is [aimed](Self::aim) elsewhere: what is looked at
    /// was made for them.
    pub fn light(&mut self, sources: &[usize]) {
        self.planner.light(sources);
        self.drawing.forget();
    }

    /// Chooses the sources for where the eye is; whether they are others than before.
    pub(super) fn choose_sources(&mut self) -> bool {
        let aim = self.aim;
        self.choose(|choice| choice.follow(&aim))
    }

    /// Those that are lit where nothing is known of the eye, until it is aimed again.
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
