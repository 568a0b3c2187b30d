//! Which pupils a refinement's steps look through, and the light that they see.

use super::super::sampling::{Diameters, PupilRange};
use super::Refiner;
use crate::optics::{Pupil, SourceChoice};

impl Refiner {
    /// Pupils for the next step: around the eye, and now and then anywhere; the surer that it is there, the rarer.
    pub(super) fn draw(&mut self) -> Vec<Pupil> {
        let (aim, eyebox) = (self.aim, self.problem.eyebox);
        self.drawn_for = aim;
        let count = self.steering.pupils as f64;
        let elsewhere = aim.elsewhere.clamp(0.0, 1.0);
        // Where it may well be anywhere, some of the pupils around it go there instead.
        let moved = (count * (elsewhere - 0.5).max(0.0) * 2.0).floor();
        self.due += self.steering.elsewhere + moved;
        let mut pupils: Vec<Pupil> = (0..(count - moved) as usize).map(|_| aim.pupil(self.points.draw())).collect();
        while self.due >= 1.0 || pupils.is_empty() {
            self.due -= 1.0;
            let [x, y, d, z] = self.points.draw();
            let pupil = aim.pupil([0.0, 0.0, d, z]);
            if !self.problem.regions.is_empty() {
                let (diameter, depth) = ([pupil.diameter; 2], [pupil.depth; 2]);
                let range = PupilRange { eyebox, diameter, depth, diameters: Diameters::Uniform };
                pupils.push(range.within(&self.problem.regions, [d, x, y, z]));
                continue;
            }
            let reach = (eyebox / 2.0 - pupil.diameter / 2.0).max(0.0);
            let [left, top] = self.problem.optics.center();
            pupils.push(Pupil { x: left + reach * (2.0 * x - 1.0), y: top + reach * (2.0 * y - 1.0), ..pupil });
        }
        pupils
    }

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
        self.pupil_passes.clear();
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
