//! What the numbers of a report come to. Scores of all colours count alike: a summary over a scene pools the pupils of
//! all its colours, one over scenes pools their scenes.

use super::Report;
use crate::evaluate::figures::{Row, Run};
use eyebox::evaluate::{Group, Summary};

/// A method with a number of sub-frames: one line of every plot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Series {
    /// Name of the method.
    pub method: String,
    /// Sub-frames.
    pub frames: usize,
}

impl Report {
    /// All series for which there is a result, by method, then sub-frames.
    pub fn series(&self) -> Vec<Series> {
        let mut all = Vec::new();
        for method in &self.methods {
            let mut frames: Vec<usize> =
                self.runs.iter().filter(|r| r.method == method.name).map(|r| r.frames).collect();
            frames.sort_unstable();
            frames.dedup();
            all.extend(frames.into_iter().map(|frames| Series { method: method.name.clone(), frames }));
        }
        all
    }

    /// Each method at its largest number of sub-frames: what is drawn where one line a method is enough.
    pub fn leading(&self) -> Vec<Series> {
        let all = self.series();
        let last = |s: &Series| all.iter().filter(|o| o.method == s.method).all(|o| o.frames <= s.frames);
        all.iter().filter(|s| last(s)).cloned().collect()
    }

    /// What people call a series; its sub-frames only where that tells something.
    pub fn label(&self, series: &Series) -> String {
        let title = self.title(&series.method);
        let several = self.about.frames.len() > 1 || self.runs.iter().any(|r| r.frames != series.frames);
        if several { format!("{title}, {} frames", series.frames) } else { title }
    }

    /// What people call a method.
    pub fn title(&self, method: &str) -> String {
        self.methods.iter().find(|m| m.name == method).map_or(method.to_string(), |m| m.title.clone())
    }

    /// Place of a method among the methods: it decides its colour.
    pub fn place(&self, method: &str) -> usize {
        self.methods.iter().position(|m| m.name == method).unwrap_or(0)
    }

    /// The results of a series, of one scene or of all.
    pub fn runs_of(&self, series: &Series, scene: Option<&str>) -> impl Iterator<Item = &Run> + Clone + use<'_> {
        let of =
            |r: &&Run| r.method == series.method && r.frames == series.frames && scene.is_none_or(|s| r.scene == s);
        self.runs.iter().filter(of).collect::<Vec<_>>().into_iter()
    }

    /// Scores of a series.
    pub fn rows(
        &self,
        series: &Series,
        scene: Option<&str>,
        group: Option<Group>,
    ) -> impl Iterator<Item = &Row> + Clone + use<'_> {
        self.runs_of(series, scene).flat_map(|r| &r.rows).filter(move |r| group.is_none_or(|g| r.group == g))
    }

    /// PSNR of a series.
    pub fn psnr(&self, series: &Series, scene: Option<&str>, group: Option<Group>) -> Option<Summary> {
        Summary::of(&self.rows(series, scene, group).map(|r| r.psnr).collect::<Vec<_>>())
    }

    /// SSIM of a series, where there is one.
    pub fn ssim(&self, series: &Series, scene: Option<&str>, group: Option<Group>) -> Option<Summary> {
        Summary::of(&self.rows(series, scene, group).filter_map(|r| r.ssim).collect::<Vec<_>>())
    }

    /// Mean PSNR of the pupil at one place of a group, over colours and scenes.
    pub fn at(&self, series: &Series, scene: Option<&str>, group: Group, index: usize) -> Option<f64> {
        mean(self.rows(series, scene, Some(group)).filter(|r| r.index == index).map(|r| r.psnr))
    }

    /// Names of the scenes.
    pub fn scene_names(&self) -> Vec<&str> {
        self.scenes.iter().map(|s| &s.name[..]).collect()
    }
}

/// Arithmetic mean; none of nothing.
pub fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0usize), |(s, n), v| (s + v, n + 1));
    (count > 0).then(|| sum / count as f64)
}
