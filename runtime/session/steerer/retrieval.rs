//! What a scene begins with that brings no phases and that the phases before do not fit: those that every picture on this display can
//! begin with, from which the next step is a phase retrieval of one step ([`fixed_phases`](crate::solve::fixed_phases)).

use super::{Followed, SteeredColor, Steerer};
use crate::engine::EngineError;
use crate::session::error::SessionError;
use crate::solve;

/// The phases of each colour that any picture can begin with, from the user's cache or fitted, which `fitting` is told; empty for
/// colours that have none. Eyes focus within `depth`, metres.
///
/// # Errors
/// Those of the fit.
pub fn fixed_phases(
    colors: &[SteeredColor],
    depth: [f64; 2],
    fitting: impl Fn(),
) -> Result<Vec<Vec<f32>>, SessionError> {
    let one = |color: &SteeredColor| {
        let phases = solve::fixed_phases(&color.problem, color.frames(), depth, &fitting)?;
        Ok(phases.unwrap_or_default())
    };
    colors.iter().map(one).collect()
}

impl Steerer {
    /// With the phases of each colour that every picture can begin with: (frames, height, width), radians; empty where there are none.
    /// Colours that share their sub-frames have no use for them: phases of one colour are not those of another.
    #[must_use]
    pub fn with_fixed_phases(mut self, fixed: Vec<Vec<f32>>) -> Self {
        if self.shared.is_some() {
            return self;
        }
        for (color, fixed) in self.colors.iter_mut().zip(fixed) {
            color.fixed = fixed;
        }
        self
    }

    /// Whether [`fit`](Self::fit) has something to look at: a scene came that is another picture altogether, and brought no phases.
    pub fn wants_fit(&self) -> bool {
        self.colors.iter().any(|color| color.unfit)
    }

    /// Colours whose scene is another picture altogether go on with the phases as they are, or with those of a retrieval in one step,
    /// whichever lose less through the same pupils, which the retrieval has not seen.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn fit(&mut self) -> Result<Followed, EngineError> {
        let mut followed = Followed::default();
        for color in self.colors.iter_mut().filter(|color| color.unfit) {
            color.unfit = false;
            let before = color.refiner.phases()?;
            color.refiner.retrieve(&color.fixed)?;
            let retrieved = color.refiner.loss()?;
            let phases = color.refiner.phases()?;
            color.refiner.restart(&before)?;
            followed.looks += 3;
            if color.refiner.loss()? < retrieved {
                followed.kept += 1;
            } else {
                color.refiner.go_on_with(&phases)?;
                followed.retrieved += 1;
            }
        }
        Ok(followed)
    }

    /// Begins with a retrieval in one step from the phases that every picture can begin with, whatever is lost.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn retrieve(&mut self) -> Result<(), EngineError> {
        for color in self.colors.iter_mut().filter(|color| !color.fixed.is_empty()) {
            color.unfit = false;
            color.refiner.retrieve(&color.fixed)?;
        }
        Ok(())
    }

    /// Begins with the phases that every picture can begin with, as they are.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn begin_fixed(&mut self) -> Result<(), EngineError> {
        for color in self.colors.iter_mut().filter(|color| !color.fixed.is_empty()) {
            color.unfit = false;
            color.refiner.restart(&color.fixed)?;
        }
        Ok(())
    }
}
