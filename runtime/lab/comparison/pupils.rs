//! Defines the pupils of a comparison.

use eyebox::low_level::evaluate::{self, Group, Member};
use eyebox::low_level::optics::Pupil;
use eyebox::low_level::solve::{Diameters, PupilRange, Sampler, Sequence};

/// The number of random pupils. They have the distribution of the paper.
const RANDOM: usize = 24;
/// The seed of the random pupils. No solve uses it.
const SEED: u64 = 0x6576_616c;
/// The number of pictures of the focal strip.
const STRIP: usize = 5;

/// A pupil of the groups whose picture is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PicturedPupil {
    /// The name for reports.
    pub title: &'static str,
    /// The group of the pupil.
    pub group: Group,
    /// The index in its group.
    pub index: usize,
}

/// The pupils whose pictures are shown for each scene, from the easiest to the hardest.
pub const SHOWN: [PicturedPupil; 4] = [
    PicturedPupil { title: "Whole eyebox", group: Group::VaryingAperture, index: 8 },
    PicturedPupil { title: "Random pupil", group: Group::Random, index: 0 },
    PicturedPupil { title: "Corner of the eyebox", group: Group::NearFocus, index: 0 },
    PicturedPupil { title: "Smallest pupil", group: Group::VaryingAperture, index: 0 },
];

/// The pupils of one scene on one display.
#[derive(Debug, Clone)]
pub struct Pupils {
    /// The members of the five groups.
    pub members: Vec<Member>,
    /// The indices of the members that are judged in JOD.
    pub judged: Vec<usize>,
    /// Pupils of 80 % of the eyebox, focused through the scene from the farthest depth on.
    pub strip: Vec<Pupil>,
    /// The sweeps at near and at far focus.
    pub sweeps: [Vec<Pupil>; 2],
    /// The places at which light is collected to measure the evenness of the eyebox.
    pub grid: Vec<Pupil>,
}

impl Pupils {
    /// Makes the pupils for an eyebox of this side and a scene of this farthest and nearest depth, all in meters. The
    /// random pupils have these diameters. At most `judged` pupils per group are judged in JOD.
    pub fn new(eyebox: f64, diameter: [f64; 2], depth: [f64; 2], judged: usize) -> Self {
        let range = PupilRange { eyebox, diameter, depth, diameters: Diameters::Uniform };
        let mut sampler = Sampler::new(range, Sequence::Random, SEED);
        let random: Vec<Pupil> = (0..RANDOM).map(|_| sampler.draw()).collect();
        let [far, near] = depth;
        let strip = (0..STRIP).map(|i| Pupil {
            x: 0.0,
            y: 0.0,
            diameter: 0.8 * eyebox,
            depth: far + (near - far) * i as f64 / (STRIP - 1) as f64,
        });
        let members = evaluate::members(eyebox, depth, &random);
        Self {
            judged: super::judged::judged(&members, judged),
            members,
            strip: strip.collect(),
            sweeps: [near, far].map(|z| evaluate::sweep(eyebox, z)),
            grid: evaluate::places(eyebox, eyebox / 8.0, 9, 0.0),
        }
    }

    /// Returns the index of a shown pupil among the members.
    pub fn place(&self, shown: &PicturedPupil) -> usize {
        let of_group = self.members.iter().enumerate().filter(|(_, m)| m.group == shown.group);
        of_group.map(|(i, _)| i).nth(shown.index).expect("every group has this pupil")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shown_pupils_are_what_their_titles_say() {
        let pupils = Pupils::new(22e-3, [2e-3, 20e-3], [-2e-3, 3e-3], 4);
        assert_eq!(pupils.members.len(), 9 + 9 + 25 + 25 + 24);
        let of = |i: usize| pupils.members[pupils.place(&SHOWN[i])];
        assert!((of(0).pupil.diameter - 22e-3).abs() < 1e-12 && of(0).pupil.x == 0.0);
        assert_eq!(of(1).group, Group::Random);
        assert!(of(2).pupil.x < 0.0 && of(2).pupil.y < 0.0 && of(2).pupil.depth == 3e-3);
        assert!((of(3).pupil.diameter - 2e-3).abs() < 1e-12);
        assert_eq!((pupils.strip.len(), pupils.sweeps[0].len(), pupils.grid.len()), (5, 31, 81));
        assert!(pupils.strip[0].depth < pupils.strip[4].depth && pupils.sweeps[0][0].depth > pupils.sweeps[1][0].depth);
    }
}
