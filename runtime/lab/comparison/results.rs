//! Defines the results of a comparison as plain data for files and reports.
//!
//! Scores of all colors count alike. A summary over a scene pools the pupils of all its colors. A summary over scenes
//! pools their scenes.

pub use super::light_figures::{CoherenceFigures, EtendueFigures};
use super::shown::{Picture, Pictures};
use eyebox::low_level::error::Reason;
use eyebox::low_level::evaluate::{Group, Summary};
use eyebox::low_level::optics::Color;
use eyebox::low_level::quality::QualityError;
use eyebox::low_level::reason;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The scores of one pupil in one color.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Row {
    /// The color of the light.
    pub color: Color,
    /// The group of the pupil.
    pub group: Group,
    /// The index in its group.
    pub index: usize,
    /// The pupil as x, y, diameter and focus, in mm.
    pub pupil_mm: [f64; 4],
    /// The focus of the pupil in dioptres.
    pub focus_dioptres: f64,
    /// The PSNR in dB. `None` if the target image is black.
    pub psnr: Option<f64>,
    /// The highest PSNR that any hologram can reach there, in dB. `None` if diffraction takes nothing or the limit is
    /// unknown.
    pub ceiling: Option<f64>,
    /// The SSIM. `None` for pictures smaller than its window.
    pub ssim: Option<f64>,
    /// Just-objectionable differences on a scale with 10 as the best, of all colors together. The rows of all colors
    /// hold the same value. `None` for pupils that were not judged.
    pub jod: Option<f64>,
}

/// The figures of one color.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ColorFigures {
    /// The color of the light.
    pub color: Color,
    /// The one exposure of all pupils, fitted over the focal stack.
    pub exposure: f64,
    /// The coefficient of variation, over the eyebox, of the light through a small pupil.
    pub variation: f64,
    /// The PSNR of the epipolar slices at near and at far focus, in dB. `None` if the slices of the target images are
    /// black.
    pub epipolar: [Option<f64>; 2],
}

/// The color error over the random pupils, as mean CIEDE2000.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct ColorError {
    /// The error near edges in depth. `None` if the scene has no such edge.
    pub edges: Option<f64>,
    /// The error everywhere else.
    pub elsewhere: Option<f64>,
    /// The share of the picture that is near edges.
    pub share: f64,
}

/// One hologram, measured against one scene.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Run {
    /// The name of the scene.
    pub scene: String,
    /// The name of the method, or the name that the hologram was given.
    pub method: String,
    /// The number of sub-frames per color.
    pub frames: usize,
    /// The seconds of the solve over all colors. `None` for a hologram that existed before.
    pub seconds: Option<f64>,
    /// The figures of each color.
    pub colors: Vec<ColorFigures>,
    /// The scores of each color and pupil.
    pub rows: Vec<Row>,
    /// The color error. `None` for pictures without all three colors or without depth.
    pub color_error: Option<ColorError>,
    /// The pictures, which only the page shows.
    pub pictures: Pictures,
}

impl Run {
    /// Returns the JOD of each pupil of a group once, because all colors of a pupil have the same value.
    fn jod(&self, group: Group) -> impl Iterator<Item = f64> {
        let color = self.colors.first().map(|c| c.color);
        self.rows.iter().filter(move |r| r.group == group && Some(r.color) == color).filter_map(|r| r.jod)
    }
}

/// A scene and its target images.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SceneFigures {
    /// The name of the scene.
    pub name: String,
    /// Rows and columns of views.
    pub views: [usize; 2],
    /// The farthest and the nearest focus, in mm.
    pub depth_mm: [f64; 2],
    /// The farthest and the nearest focus, in dioptres.
    pub depth_dioptres: [f64; 2],
    /// The row of the picture whose epipolar slices are shown.
    pub row: usize,
    /// The target images of the scene.
    pub pictures: Pictures,
}

impl SceneFigures {
    /// Returns the depths in both units.
    pub fn depths_in_words(&self) -> String {
        let ([far, near], [least, most]) = (self.depth_mm, self.depth_dioptres);
        format!("{far:.2} to {near:.2} mm ({least:.3} to {most:.3} D)")
    }
}

/// The speckle of an even plane.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SpeckleFigures {
    /// The name of the method.
    pub method: String,
    /// Pairs of (sub-frames, contrast) of independent frames.
    pub independent: Vec<(usize, f64)>,
    /// Pairs of (sub-frames, contrast) of frames that were optimized together.
    pub joint: Vec<(usize, f64)>,
    /// The side of the plane, in pixels.
    pub side: usize,
    /// The color of the light.
    pub color: Color,
    /// The diameter of the pupil, in mm.
    pub diameter_mm: f64,
}

/// One way of lighting sub-frames with all colors, measured against one scene.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct JointFigures {
    /// The name of the scene.
    pub scene: String,
    /// The number of sub-frames in all.
    pub frames: usize,
    /// The name of the way of lighting for reports.
    pub way: String,
    /// The brightness of white relative to one color after another, by lasers of the same peak power.
    pub brightness: f64,
    /// The mean PSNR over random pupils and colors, in dB.
    pub mean_db: Option<f64>,
    /// The worst PSNR over random pupils and colors, in dB.
    pub worst_db: Option<f64>,
    /// The mean PSNR of each color, in dB.
    pub colors_db: Vec<(Color, f64)>,
    /// The powers of the lasers in each sub-frame, relative to their mean. `None` for one color after another.
    pub powers: Option<Vec<(Color, Vec<f64>)>>,
    /// The picture through a pupil of a quarter of the eyebox, in its middle.
    pub picture: Option<Picture>,
}

/// The score at one place of the eyebox of a display's switchable sources.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SourcesFigures {
    /// The name of the scene.
    pub scene: String,
    /// The number of sub-frames per color.
    pub frames: usize,
    /// The name of the way of lighting for reports.
    pub way: String,
    /// The position of the eye as (x, y), in mm.
    pub place_mm: [f64; 2],
    /// The largest number of sources of any color that are lit for the eye. 0 if the sources do not follow the eye.
    pub lit: usize,
    /// The mean PSNR over pupils there and colors, in dB.
    pub mean_db: Option<f64>,
    /// The worst PSNR over pupils there and colors, in dB.
    pub worst_db: Option<f64>,
    /// The picture at this position.
    pub picture: Option<Picture>,
}

/// The conditions that all results of a comparison share.
#[derive(Debug, Clone, Serialize)]
pub struct About {
    /// The version of eyebox.
    pub version: String,
    /// The name of the display.
    pub display: String,
    /// Rows and columns of the SLM, in pixels.
    pub size: [usize; 2],
    /// The pixel pitch, in µm.
    pub pitch_um: f64,
    /// The side of the eyebox that all colors serve, in mm.
    pub eyebox_mm: f64,
    /// The reach of the display, in words.
    pub reach: String,
    /// The colors that were compared.
    pub colors: Vec<Color>,
    /// The compared numbers of sub-frames.
    pub frames: Vec<usize>,
    /// The steps of each iterative method.
    pub steps: usize,
    /// The number of pupils per step.
    pub pupils: usize,
    /// The seed of the solves.
    pub seed: u64,
    /// The description of the engine.
    pub engine: String,
    /// The viewing conditions of the JOD as luminance of white and of black, in cd/m2, and pixels per degree. `None` if
    /// nothing was judged.
    pub viewing: Option<[f64; 3]>,
}

/// The description of a method for reports.
#[derive(Debug, Clone, Serialize)]
pub struct MethodAbout {
    /// The name by which results refer to it.
    pub name: String,
    /// The title of the method.
    pub title: String,
    /// One sentence about the method.
    pub about: String,
    /// The paper of the method, or the files of existing holograms.
    pub citation: String,
}

/// One box of a published box plot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Published {
    /// The method, as its paper writes it.
    pub method: String,
    /// The group of pupils.
    pub category: String,
    /// The number of scores in the box.
    pub n: u64,
    /// The mean, in dB.
    pub mean: f64,
    /// The median, in dB.
    pub median: f64,
    /// The lower quartile, in dB.
    pub q25: f64,
    /// The upper quartile, in dB.
    pub q75: f64,
    /// The worst score, in dB.
    pub min: f64,
    /// The best score, in dB.
    pub max: f64,
    /// The standard deviation, in dB.
    pub std: f64,
}

impl Published {
    /// Reads all rows of a CSV file with the columns method, category, n, mean, median, q25, q75, min, max, std.
    ///
    /// # Errors
    /// Returns [`QualityError::Input`] if the file is unreadable, has other columns, has no rows or has a number that
    /// is not finite.
    pub fn read(file: &Path) -> Result<Vec<Self>, QualityError> {
        let wrong = |reason: Reason| QualityError::Input {
            what: file.display().to_string(),
            reason: reason.reworded(|text| text.replace('\n', " ")),
        };
        let text = eyebox::low_level::files::read::text(file, eyebox::low_level::files::read::TABLE)
            .map_err(|e| wrong(e.to_string().into()))?;
        let rows: Result<Vec<Self>, _> =
            csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes()).deserialize().collect();
        let rows = rows.map_err(|e| {
            wrong(reason!("columns", "{e}. The columns must be method,category,n,mean,median,q25,q75,min,max,std."))
        })?;
        let numbers = |r: &Self| [r.mean, r.median, r.q25, r.q75, r.min, r.max, r.std];
        match rows.iter().position(|r| numbers(r).iter().any(|v| !v.is_finite())) {
            Some(row) => Err(wrong(reason!("not-finite", "row {}: a number is not finite", row + 1))),
            None if rows.is_empty() => Err(wrong(reason!("no-rows", "the table has no rows"))),
            None => Ok(rows),
        }
    }

    /// Returns true if the box belongs to this method and group.
    pub(crate) fn is_of(&self, method: &str, group: Group) -> bool {
        self.method.eq_ignore_ascii_case(method) && self.category.eq_ignore_ascii_case(group.name())
    }
}

/// All results of a comparison.
#[derive(Debug, Clone, Serialize)]
pub struct Results {
    /// The conditions of the comparison.
    pub about: About,
    /// The methods in their order.
    pub methods: Vec<MethodAbout>,
    /// The figures of the scenes.
    pub scenes: Vec<SceneFigures>,
    /// Each hologram against its scene.
    pub runs: Vec<Run>,
    /// The speckle of an even plane.
    pub speckle: Vec<SpeckleFigures>,
    /// Simultaneous color against one color after another. Empty if they were not compared.
    pub joint: Vec<JointFigures>,
    /// Sources of several sizes. Empty if they were not compared.
    pub coherence: Vec<CoherenceFigures>,
    /// Masks in front of the SLM. Empty if they were not compared.
    pub etendue: Vec<EtendueFigures>,
    /// Places across the eyebox of switchable sources. Empty if they were not compared.
    pub sources: Vec<SourcesFigures>,
    /// Published numbers, shown next to the measurements.
    pub published: Vec<Published>,
    /// The number of results that are not there yet.
    pub missing: usize,
}

/// A method with a number of sub-frames, which is one line of each plot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Series {
    /// The name of the method.
    pub method: String,
    /// The number of sub-frames.
    pub frames: usize,
}

impl Results {
    /// Lists all series with a result, by method and then by sub-frames.
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

    /// Lists each method at its largest number of sub-frames, for plots with one line per method.
    pub fn leading(&self) -> Vec<Series> {
        let all = self.series();
        let last = |s: &Series| all.iter().filter(|o| o.method == s.method).all(|o| o.frames <= s.frames);
        all.iter().filter(|s| last(s)).cloned().collect()
    }

    /// Returns the label of a series. It states the sub-frames only if they differ among the results.
    pub fn label(&self, series: &Series) -> String {
        let title = self.title(&series.method);
        let several = self.about.frames.len() > 1 || self.runs.iter().any(|r| r.frames != series.frames);
        if several { format!("{title}, {} frames", series.frames) } else { title }
    }

    /// Returns the title of a method.
    pub fn title(&self, method: &str) -> String {
        self.methods.iter().find(|m| m.name == method).map_or(method.to_string(), |m| m.title.clone())
    }

    /// Returns the results of a series, for one scene or for all.
    pub(crate) fn runs_of<'a>(
        &'a self,
        series: &'a Series,
        scene: Option<&'a str>,
    ) -> impl Iterator<Item = &'a Run> + Clone {
        let same = |r: &&Run| r.method == series.method && r.frames == series.frames;
        self.runs.iter().filter(same).filter(move |r| scene.is_none_or(|s| r.scene == s))
    }

    /// Returns the scores of a series.
    pub fn rows<'a>(
        &'a self,
        series: &'a Series,
        scene: Option<&'a str>,
        group: Group,
    ) -> impl Iterator<Item = &'a Row> + Clone {
        self.runs_of(series, scene).flat_map(|r| &r.rows).filter(move |r| r.group == group)
    }

    /// Returns the PSNR of a series, in dB.
    pub fn psnr(&self, series: &Series, scene: Option<&str>, group: Group) -> Option<Summary> {
        Summary::of(&self.rows(series, scene, group).filter_map(|r| r.psnr).collect::<Vec<_>>())
    }

    /// Returns the SSIM of a series. `None` if no row has one.
    pub fn ssim(&self, series: &Series, scene: Option<&str>, group: Group) -> Option<Summary> {
        Summary::of(&self.rows(series, scene, group).filter_map(|r| r.ssim).collect::<Vec<_>>())
    }

    /// Returns the JOD of a series, over the pupils that were judged.
    pub fn jod(&self, series: &Series, scene: Option<&str>, group: Group) -> Option<Summary> {
        Summary::of(&self.runs_of(series, scene).flat_map(|run| run.jod(group)).collect::<Vec<_>>())
    }

    /// Returns the number of judged pupils per group. `None` if no pupil was judged.
    pub(crate) fn judged(&self) -> Option<usize> {
        let series = self.series().into_iter().next()?;
        let run = self.runs_of(&series, None).next()?;
        Some(run.jod(Group::Random).count()).filter(|n| *n > 0)
    }

    /// Returns the mean PSNR of the pupil at one place of a group, over colors and scenes, in dB.
    pub fn at(&self, series: &Series, scene: Option<&str>, group: Group, index: usize) -> Option<f64> {
        mean(self.rows(series, scene, group).filter(|r| r.index == index).filter_map(|r| r.psnr))
    }

    /// Returns the mean ceiling of the pupil at one place of a group, over colors and scenes, in dB. `None` if a row
    /// has no ceiling.
    pub(crate) fn ceiling_at(&self, group: Group, index: usize) -> Option<f64> {
        let series = self.leading().into_iter().next()?;
        let all: Option<Vec<f64>> =
            self.rows(&series, None, group).filter(|r| r.index == index).map(|r| r.ceiling).collect();
        mean(all?.into_iter())
    }

    /// Returns the mean of a figure over colors and scenes.
    pub(crate) fn mean_of(&self, series: &Series, figure: impl Fn(&ColorFigures) -> Option<f64>) -> Option<f64> {
        mean(self.runs_of(series, None).flat_map(|r| &r.colors).filter_map(figure))
    }

    /// Returns the mean color error over scenes, near edges in depth and elsewhere.
    pub(crate) fn color_error(&self, series: &Series) -> [Option<f64>; 2] {
        let errors = || self.runs_of(series, None).filter_map(|r| r.color_error);
        [mean(errors().filter_map(|e| e.edges)), mean(errors().filter_map(|e| e.elsewhere))]
    }
}

/// Returns the arithmetic mean, or `None` without values.
pub fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0usize), |(s, n), v| (s + v, n + 1));
    (count > 0).then(|| sum / count as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_rows_are_read_and_mistakes_are_one_line() {
        let here = tempfile::tempdir().unwrap();
        let file = here.path().join("p.csv");
        let head = "method,category,n,mean,median,q25,q75,min,max,std\n";
        std::fs::write(&file, format!("{head}SLFH,Random pupils,70,28.6,29.4,24.8,30.9,22.9,37.7,3.8\n")).unwrap();
        let rows = Published::read(&file).unwrap();
        assert!(rows[0].is_of("slfh", Group::Random) && !rows[0].is_of("stft", Group::Random));
        for wrong in [
            head.to_string(),
            format!("{head}SLFH,x,70,a,1,1,1,1,1,1\n"),
            "a,b\n1,2\n".into(),
            "\u{0}".into(),
            format!("{head}SLFH,x,70,NaN,1,1,1,1,1,1\n"),
        ] {
            std::fs::write(&file, wrong).unwrap();
            let said = Published::read(&file).unwrap_err().to_string();
            assert!(said.contains("p.csv") && said.lines().count() == 1, "{said}");
        }
        assert!(Published::read(&here.path().join("none.csv")).is_err());
    }
}
