//! Defines the five groups of pupils with which the paper compares methods, for any display and scene.
//!
//! The groups are those in figure 12 of the paper.

use crate::optics::Pupil;
use serde::{Deserialize, Serialize};

/// One of the five groups of pupils.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Group {
    /// Centered pupils from narrow to wide, focused at the middle of the scene.
    VaryingAperture,
    /// Centered pupils as wide as the eyebox, focused through the scene's depths.
    FocalStack,
    /// Pupils a quarter of the eyebox wide, all over it, focused at the near end.
    NearFocus,
    /// Pupils a quarter of the eyebox wide, all over it, focused at the far end.
    FarFocus,
    /// Pupils with uniformly random position, diameter and focus.
    Random,
}

/// Number of steps of the aperture and of the focus.
const STEPS: usize = 9;
/// Number of positions along each axis in the light field groups.
const PLACES: usize = 5;

impl Group {
    /// All groups in the paper's order.
    pub const ALL: [Self; 5] = [Self::VaryingAperture, Self::FocalStack, Self::NearFocus, Self::FarFocus, Self::Random];

    /// Returns the paper's name of the group.
    pub fn name(self) -> &'static str {
        match self {
            Self::VaryingAperture => "Varying aperture",
            Self::FocalStack => "Focal stack",
            Self::NearFocus => "LF near focus",
            Self::FarFocus => "LF far focus",
            Self::Random => "Random pupils",
        }
    }

    /// Returns a description of the group in one sentence.
    pub fn about(self) -> &'static str {
        match self {
            Self::VaryingAperture => {
                "centered pupil focused at the middle of the scene, from 1/11 of the eyebox to all of it"
            }
            Self::FocalStack => "centered pupil as wide as the eyebox, focused through the scene",
            Self::NearFocus => "a quarter of the eyebox wide, 5 x 5 places, focused at the near end",
            Self::FarFocus => "a quarter of the eyebox wide, 5 x 5 places, focused at the far end",
            Self::Random => "place, diameter and focus uniformly random",
        }
    }

    /// Returns the pupils of a group without randomness, and none for [`Group::Random`]. `eyebox` is the side, in
    /// meters, that all colors serve. `far` and `near` are the scene's farthest and nearest depth, in meters.
    pub fn pupils(self, eyebox: f64, [far, near]: [f64; 2]) -> Vec<Pupil> {
        let middle = (far + near) / 2.0;
        let share = |i: usize, n: usize| i as f64 / (n - 1) as f64;
        match self {
            Self::VaryingAperture => (0..STEPS)
                .map(|i| {
                    // The diameters go from a narrow pupil to the whole eyebox, evenly in log d.
                    let diameter = eyebox * 11f64.powf(share(i, STEPS) - 1.0);
                    Pupil { x: 0.0, y: 0.0, diameter, depth: middle }
                })
                .collect(),
            Self::FocalStack => (0..STEPS)
                .map(|i| Pupil { x: 0.0, y: 0.0, diameter: eyebox, depth: far + (near - far) * share(i, STEPS) })
                .collect(),
            Self::NearFocus => places(eyebox, eyebox / 4.0, PLACES, near),
            Self::FarFocus => places(eyebox, eyebox / 4.0, PLACES, far),
            Self::Random => Vec::new(),
        }
    }
}

/// Returns pupils of one diameter on a grid of `n` x `n` positions, row by row. The outermost pupils touch the eyebox's
/// edge.
pub fn places(eyebox: f64, diameter: f64, n: usize, depth: f64) -> Vec<Pupil> {
    let reach = ((eyebox - diameter) / 2.0).max(0.0);
    let at = |i: usize| if n > 1 { reach * (2.0 * i as f64 / (n - 1) as f64 - 1.0) } else { 0.0 };
    (0..n * n).map(|i| Pupil { x: at(i % n), y: at(i / n), diameter, depth }).collect()
}

/// A pupil with its group.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Member {
    /// The group of the pupil.
    pub group: Group,
    /// The pupil, in meters.
    pub pupil: Pupil,
}

/// Returns all groups, one after the other. `random` are the pupils of the last group.
pub fn members(eyebox: f64, depth: [f64; 2], random: &[Pupil]) -> Vec<Member> {
    let fixed = Group::ALL
        .into_iter()
        .flat_map(|group| group.pupils(eyebox, depth).into_iter().map(move |pupil| Member { group, pupil }));
    fixed.chain(random.iter().map(|&pupil| Member { group: Group::Random, pupil })).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const EYEBOX: f64 = 22e-3;
    const DEPTH: [f64; 2] = [-2e-3, 3e-3];

    #[test]
    fn groups_are_the_papers() {
        let close = |a: f64, b: f64| (a - b).abs() < 1e-12;
        let aperture = Group::VaryingAperture.pupils(EYEBOX, DEPTH);
        assert!(close(aperture[0].diameter, 2e-3) && close(aperture[8].diameter, 22e-3) && aperture.len() == 9);
        assert!(aperture.iter().all(|p| p.x == 0.0 && p.y == 0.0 && close(p.depth, 0.5e-3)));
        assert!(aperture.windows(2).all(|p| close(p[1].diameter / p[0].diameter, 11f64.powf(0.125))));
        let stack = Group::FocalStack.pupils(EYEBOX, DEPTH);
        assert!(close(stack[0].depth, -2e-3) && close(stack[8].depth, 3e-3) && close(stack[4].depth, 0.5e-3));
        assert!(stack.iter().all(|p| p.diameter == EYEBOX));
        for (group, depth) in [(Group::NearFocus, 3e-3), (Group::FarFocus, -2e-3)] {
            let field = group.pupils(EYEBOX, DEPTH);
            assert!(field.len() == 25 && field.iter().all(|p| p.depth == depth && close(p.diameter, 5.5e-3)));
            let reach = field.iter().map(|p| p.x.abs().max(p.y.abs()) + p.diameter / 2.0).fold(0.0, f64::max);
            assert!(close(reach, EYEBOX / 2.0));
            assert!(
                field[12].x.abs() < 1e-15 && field[12].y.abs() < 1e-15 && field[0].x < 0.0 && field[1].x > field[0].x
            );
        }
    }

    #[test]
    fn members_keep_their_groups() {
        let random = [Pupil { x: 1e-3, y: 0.0, diameter: 2e-3, depth: 0.0 }; 24];
        let all = members(EYEBOX, DEPTH, &random);
        let count = |g| all.iter().filter(|m| m.group == g).count();
        assert_eq!(Group::ALL.map(count), [9, 9, 25, 25, 24]);
    }
}
