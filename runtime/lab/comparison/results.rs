//! What a comparison comes to, as plain data: kept in files, put into reports. Scores of all colours count alike: a summary
//! over a scene pools the pupils of all its colours, one over scenes pools their scenes.

pub use super::light_figures::{CoherenceFigures, EtendueFigures};
use super::shown::{Picture, Pictures};
use eyebox::low_level::error::Reason;
use eyebox::low_level::evaluate::{Group, Summary};
use eyebox::low_level::optics::Color;
use eyebox::low_level::quality::QualityError;
use eyebox::low_level::reason;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// What one pupil scored in one colour.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Row {
    /// Colour.
    pub color: Color,
    /// Group of the pupil.
    pub group: Group,
    /// Place in its group.
    pub index: usize,
    /// x, y, diameter, focus, mm.
    pub pupil_mm: [f64; 4],
    /// The focus, dioptres.
    pub focus_dioptres: f64,
    /// dB; `None` if the photograph is black.
    pub psnr: Option<f64>,
    /// The most that any hologram could have there, dB; none where diffraction takes nothing, or where it is not known.
    pub ceiling: Option<f64>,
    /// None for pictures smaller than its window.
    pub ssim: Option<f64>,
    /// Just-objectionable differences from 10, of all colours together and so the same in the rows of each; none for pupils
    /// that were not judged.
    pub jod: Option<f64>,
}

/// Figures of one colour.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ColorFigures {
    /// Which.
    pub color: Color,
    /// The one exposure of all pupils, fitted over the focal stack.
    pub exposure: f64,
    /// Coefficient of variation of the light through a small pupil over the eyebox.
    pub variation: f64,
    /// PSNR of the epipolar slices at near and at far focus, dB; `None` if those of the photographs are black.
    pub epipolar: [Option<f64>; 2],
}

/// Colour error over the random pupils, mean CIEDE2000.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct ColorError {
    /// Near edges in depth; none where the scene has no such edge.
    pub edges: Option<f64>,
    /// Everywhere else.
    pub elsewhere: Option<f64>,
    /// Share of the picture that is near edges.
    pub share: f64,
}

/// One hologram, measured against one scene.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Run {
    /// Name of the scene.
    pub scene: String,
    /// Name of the method, or the one given to the hologram.
    pub method: String,
    /// Sub-frames.
    pub frames: usize,
    /// Seconds of the solve, all colours; none for a hologram that was given.
    pub seconds: Option<f64>,
    /// Per colour.
    pub colors: Vec<ColorFigures>,
    /// Per colour and pupil.
    pub rows: Vec<Row>,
    /// None of pictures without all three colours, or without depth.
    pub color_error: Option<ColorError>,
    /// For the page alone.
    pub pictures: Pictures,
}

impl Run {
    /// JOD of a group's pupils, each once: all colours of a pupil have the same.
    fn jod(&self, group: Group) -> impl Iterator<Item = f64> {
        let color = self.colors.first().map(|c| c.color);
        self.rows.iter().filter(move |r| r.group == group && Some(r.color) == color).filter_map(|r| r.jod)
    }
}

/// A scene and its photographs.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SceneFigures {
    /// Its name.
    pub name: String,
    /// Rows and columns of views.
    pub views: [usize; 2],
    /// Farthest and nearest focus, mm.
    pub depth_mm: [f64; 2],
    /// The same in dioptres.
    pub depth_dioptres: [f64; 2],
    /// Row of the picture whose epipolar slices are shown.
    pub row: usize,
    /// Photographs.
    pub pictures: Pictures,
}

impl SceneFigures {
    /// Its depths in both units.
    pub fn depths_in_words(&self) -> String {
        let ([far, near], [least, most]) = (self.depth_mm, self.depth_dioptres);
        format!("{far:.2} to {near:.2} mm ({least:.3} to {most:.3} D)")
    }
}

/// Speckle of an even plane.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SpeckleFigures {
    /// Method.
    pub method: String,
    /// (sub-frames, contrast) of independent frames.
    pub independent: Vec<(usize, f64)>,
    /// (sub-frames, contrast) of frames that were optimised together.
    pub joint: Vec<(usize, f64)>,
    /// Side of the plane, pixels.
    pub side: usize,
    /// Colour.
    pub color: Color,
    /// Diameter of the pupil, mm.
    pub diameter_mm: f64,
}

/// One way of lighting sub-frames with all colours, measured against one scene.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct JointFigures {
    /// Name of the scene.
    pub scene: String,
    /// Sub-frames in all.
    pub frames: usize,
    /// How they are lit, for people.
    pub way: String,
    /// How bright white is, times that of one colour after another by lasers of the same peak power.
    pub brightness: f64,
    /// PSNR over random pupils and colours, dB: mean,
    pub mean_db: Option<f64>,
    /// and worst.
    pub worst_db: Option<f64>,
    /// The mean of each colour, dB.
    pub colors_db: Vec<(Color, f64)>,
    /// Powers of the lasers in each sub-frame, over their mean; none in sequence.
    pub powers: Option<Vec<(Color, Vec<f64>)>>,
    /// Through a pupil of a quarter of the eyebox, in its middle.
    pub picture: Option<Picture>,
}

/// What an eye sees at one place of the eyebox of a display's switchable sources.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SourcesFigures {
    /// Name of the scene.
    pub scene: String,
    /// Sub-frames.
    pub frames: usize,
    /// How the sources are lit, for people.
    pub way: String,
    /// Where the eye is, mm (x, y).
    pub place_mm: [f64; 2],
    /// Sources that are lit for it, at most in any colour; 0 where they do not follow it.
    pub lit: usize,
    /// PSNR over pupils there and colours, dB: mean,
    pub mean_db: Option<f64>,
    /// and worst.
    pub worst_db: Option<f64>,
    /// What is seen there.
    pub picture: Option<Picture>,
}

/// What all results of a comparison have in common.
#[derive(Debug, Clone, Serialize)]
pub struct About {
    /// Version of eyebox.
    pub version: String,
    /// Name of the display.
    pub display: String,
    /// Rows and columns.
    pub size: [usize; 2],
    /// Pixel pitch, um.
    pub pitch_um: f64,
    /// Side of the eyebox that all colours serve, mm.
    pub eyebox_mm: f64,
    /// What the display can show, in words.
    pub reach: String,
    /// Colours.
    pub colors: Vec<Color>,
    /// Sub-frames that were compared.
    pub frames: Vec<usize>,
    /// Steps of every iterative method.
    pub steps: usize,
    /// Pupils a step.
    pub pupils: usize,
    /// Seed.
    pub seed: u64,
    /// What computed it.
    pub engine: String,
    /// How the picture is seen, where it was judged in JOD: luminance of white and of black, cd/m2, and pixels a degree.
    pub viewing: Option<[f64; 3]>,
}

/// A method, for people.
#[derive(Debug, Clone, Serialize)]
pub struct MethodAbout {
    /// The name by which results refer to it.
    pub name: String,
    /// What people call it.
    pub title: String,
    /// One sentence.
    pub about: String,
    /// Its paper, or where it was read from.
    pub citation: String,
}

/// A box of a published box plot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Published {
    /// Method, as its paper writes it.
    pub method: String,
    /// Group of pupils.
    pub category: String,
    /// Number of scores.
    pub n: u64,
    /// Mean, dB.
    pub mean: f64,
    /// Median.
    pub median: f64,
    /// Lower quartile.
    pub q25: f64,
    /// Upper quartile.
    pub q75: f64,
    /// Worst.
    pub min: f64,
    /// Best.
    pub max: f64,
    /// Standard deviation.
    pub std: f64,
}

impl Published {
    /// All rows of a CSV file with the columns method, category, n, mean, median, q25, q75, min, max, std.
    ///
    /// # Errors
    /// [`QualityError::Input`].
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
            wrong(reason!("columns", "{e}; the columns are method,category,n,mean,median,q25,q75,min,max,std"))
        })?;
        let numbers = |r: &Self| [r.mean, r.median, r.q25, r.q75, r.min, r.max, r.std];
        match rows.iter().position(|r| numbers(r).iter().any(|v| !v.is_finite())) {
            Some(row) => Err(wrong(reason!("not-finite", "row {} has a number that is not finite", row + 1))),
            None if rows.is_empty() => Err(wrong(reason!("no-rows", "it has no rows"))),
            None => Ok(rows),
        }
    }

    /// Whether it is about this method and group.
    pub(crate) fn is_of(&self, method: &str, group: Group) -> bool {
        self.method.eq_ignore_ascii_case(method) && self.category.eq_ignore_ascii_case(group.name())
    }
}

/// Everything that a comparison found.
#[derive(Debug, Clone, Serialize)]
pub struct Results {
    /// What was compared, on what.
    pub about: About,
    /// The methods, in their order.
    pub methods: Vec<MethodAbout>,
    /// The scenes.
    pub scenes: Vec<SceneFigures>,
    /// Every hologram against its scene.
    pub runs: Vec<Run>,
    /// Speckle of an even plane.
    pub speckle: Vec<SpeckleFigures>,
    /// All colours at once against one colour after another; empty where they were not compared.
    pub joint: Vec<JointFigures>,
    /// Sources of several sizes; empty where they were not compared.
    pub coherence: Vec<CoherenceFigures>,
    /// Masks in front of the SLM; empty where they were not compared.
    pub etendue: Vec<EtendueFigures>,
    /// Places across the eyebox of switchable sources; empty where they were not compared.
    pub sources: Vec<SourcesFigures>,
    /// Numbers from elsewhere, shown beside.
    pub published: Vec<Published>,
    /// Results that are not there yet.
    pub missing: usize,
}

/// A method with a number of sub-frames: one line of every plot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Series {
    /// Name of the method.
    pub method: String,
    /// Sub-frames.
    pub frames: usize,
}

impl Results {
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

    /// Results of a series, of one scene or of all.
    pub(crate) fn runs_of<'a>(
        &'a self,
        series: &'a Series,
        scene: Option<&'a str>,
    ) -> impl Iterator<Item = &'a Run> + Clone {
        let same = |r: &&Run| r.method == series.method && r.frames == series.frames;
        self.runs.iter().filter(same).filter(move |r| scene.is_none_or(|s| r.scene == s))
    }

    /// Scores of a series.
    pub fn rows<'a>(
        &'a self,
        series: &'a Series,
        scene: Option<&'a str>,
        group: Group,
    ) -> impl Iterator<Item = &'a Row> + Clone {
        self.runs_of(series, scene).flat_map(|r| &r.rows).filter(move |r| r.group == group)
    }

    /// PSNR of a series, dB.
    pub fn psnr(&self, series: &Series, scene: Option<&str>, group: Group) -> Option<Summary> {
        Summary::of(&self.rows(series, scene, group).filter_map(|r| r.psnr).collect::<Vec<_>>())
    }

    /// SSIM of a series, where there is one.
    pub fn ssim(&self, series: &Series, scene: Option<&str>, group: Group) -> Option<Summary> {
        Summary::of(&self.rows(series, scene, group).filter_map(|r| r.ssim).collect::<Vec<_>>())
    }

    /// JOD of a series, over the pupils that were judged.
    pub fn jod(&self, series: &Series, scene: Option<&str>, group: Group) -> Option<Summary> {
        Summary::of(&self.runs_of(series, scene).flat_map(|run| run.jod(group)).collect::<Vec<_>>())
    }

    /// Pupils of each group that were judged, where any was.
    pub(crate) fn judged(&self) -> Option<usize> {
        let series = self.series().into_iter().next()?;
        let run = self.runs_of(&series, None).next()?;
        Some(run.jod(Group::Random).count()).filter(|n| *n > 0)
    }

    /// Mean PSNR of the pupil at one place of a group, over colours and scenes, dB.
    pub fn at(&self, series: &Series, scene: Option<&str>, group: Group, index: usize) -> Option<f64> {
        mean(self.rows(series, scene, group).filter(|r| r.index == index).filter_map(|r| r.psnr))
    }

    /// Mean ceiling of the pupil at one place of a group, over colours and scenes, dB; none where any has none.
    pub(crate) fn ceiling_at(&self, group: Group, index: usize) -> Option<f64> {
        let series = self.leading().into_iter().next()?;
        let all: Option<Vec<f64>> =
            self.rows(&series, None, group).filter(|r| r.index == index).map(|r| r.ceiling).collect();
        mean(all?.into_iter())
    }

    /// Mean over colours and scenes of a figure of the colours.
    pub(crate) fn mean_of(&self, series: &Series, figure: impl Fn(&ColorFigures) -> Option<f64>) -> Option<f64> {
        mean(self.runs_of(series, None).flat_map(|r| &r.colors).filter_map(figure))
    }

    /// Mean colour error near edges in depth, and elsewhere, over scenes.
    pub(crate) fn color_error(&self, series: &Series) -> [Option<f64>; 2] {
        let errors = || self.runs_of(series, None).filter_map(|r| r.color_error);
        [mean(errors().filter_map(|e| e.edges)), mean(errors().filter_map(|e| e.elsewhere))]
    }
}

/// Arithmetic mean; none of nothing.
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
