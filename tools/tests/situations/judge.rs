//! Judges results by their values, never by their wording.

use crate::common::eyebox;
use crate::frame::{Outcome, RENDER};
use eyebox::low_level::files::read_npy;
use std::path::Path;
use std::sync::OnceLock;

/// A result must be farther from every misreading than from the right picture by this factor.
const CLEARLY: f32 = 2.0;

/// Judges the result of a command.
pub enum Judge {
    /// `out.npy` must be the picture of this scene within an error [1 is white], which depends on the bits of the
    /// format.
    Like(&'static Canon, f32),
    /// This function judges the result.
    By(fn(&Outcome) -> Result<(), String>),
}

/// A fault of a reader, and a function that makes the files as this reader would see them.
pub type Misreading = (&'static str, fn(&Path) -> String);

/// A scene in its plainest form, and all misreadings of it that the test must notice.
pub struct Canon {
    /// Makes the files in a folder, and returns the words of the command after `render`.
    pub right: fn(&Path) -> String,
    /// The misreadings of the scene.
    pub wrong: &'static [Misreading],
    /// The last words of the command.
    words: &'static str,
    seen: OnceLock<Pictures>,
}

/// The pictures of a scene and of all its misreadings.
pub struct Pictures {
    right: Vec<f32>,
    wrong: Vec<(&'static str, Vec<f32>)>,
}

impl Canon {
    pub const fn new(right: fn(&Path) -> String, wrong: &'static [Misreading]) -> Self {
        Self::through(RENDER, right, wrong)
    }

    /// Makes a scene whose command has other last words than most.
    pub const fn through(words: &'static str, right: fn(&Path) -> String, wrong: &'static [Misreading]) -> Self {
        Self { right, wrong, words, seen: OnceLock::new() }
    }

    fn seen(&self) -> &Pictures {
        self.seen.get_or_init(|| {
            let right = self.picture(self.right).expect("eyebox reads the plainest form");
            let wrong = self.wrong.iter().filter_map(|(fault, make)| Some((*fault, self.picture(*make)?))).collect();
            Pictures { right, wrong }
        })
    }

    /// Returns the picture, or none if the command refuses the scene. A refusal cannot look like the right picture.
    fn picture(&self, make: fn(&Path) -> String) -> Option<Vec<f32>> {
        let temp = crate::common::folder();
        let words = format!("render {} {}", make(temp.path()), self.words);
        let answer = eyebox(temp.path(), &words.split_whitespace().collect::<Vec<_>>());
        let read = || read_npy(&temp.path().join("out.npy")).expect("a picture").values;
        answer.status.success().then(read)
    }
}

fn rms(a: &[f32], b: &[f32]) -> f32 {
    (a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f32>() / a.len() as f32).sqrt()
}

impl Judge {
    pub fn judge(&self, outcome: &Outcome) -> Result<(), String> {
        match self {
            Self::By(judge) => judge(outcome),
            Self::Like(canon, error) => like(outcome, canon.seen(), *error),
        }
    }
}

fn like(outcome: &Outcome, canon: &Pictures, error: f32) -> Result<(), String> {
    let found = read_npy(&outcome.folder.join("out.npy")).map_err(|e| e.to_string())?.values;
    if found.len() != canon.right.len() {
        return Err(format!("{} values instead of {}", found.len(), canon.right.len()));
    }
    let off = rms(&found, &canon.right);
    let most = found.iter().zip(&canon.right).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    let far: Vec<_> = canon.wrong.iter().map(|(fault, wrong)| (*fault, rms(&found, wrong))).collect();
    // A single pixel may have a larger error than most, such as at an edge of a depth map.
    if off <= error && most <= 20.0 * error && far.iter().all(|(_, away)| *away > CLEARLY * off.max(1e-6)) {
        return Ok(());
    }
    let said = outcome.stderr.trim();
    Err(format!("off by {off:.6} and {most:.6} at most, {error} is allowed; from others by {far:.4?}: {said}"))
}
