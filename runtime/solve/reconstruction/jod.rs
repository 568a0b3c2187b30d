//! Computes the perceived difference between a hologram and its scene, through some of many pupils.

use super::{HologramScores, ReconstructionError, Sampling, SceneSource};
use crate::engine::Engine;
use crate::evaluate::{EvaluateError, JodMetric, Judged, Plane, Rgb, lost_picture, rgb};
use crate::files::write_png;
use crate::hologram::PhaseSource;
use crate::optics::{Color, Pupil, Viewing};
use eyebox_base::reason;
use std::ops::Range;
use std::path::Path;

/// Repetitions of the sub-frames in the video of the metric. A repeating pattern becomes visible in the second one.
const SHOWN: usize = 2;

/// Side of the square around the gaze direction that is evaluated alone, in degrees. It has the size of a fovea.
pub const FOVEA_DEGREES: f64 = 5.0;
/// Smaller numbers of rows or columns in this square are not evaluated.
const LEAST: usize = 16;

/// Settings for the evaluation of a hologram with ColorVideoVDP.
#[derive(Debug, Clone, Copy)]
pub struct JodSettings<'a> {
    /// The brightness and resolution at which the picture is viewed.
    pub viewing: Viewing,
    /// Pixels per degree of the display's own picture
    /// ([`Display::pixels_per_degree`](crate::optics::Display::pixels_per_degree)).
    pub pixels_per_degree: f64,
    /// Largest number of pupils, spread evenly over the list, because the metric takes longer than the simulation.
    pub most: usize,
    /// Sub-frames per second, to evaluate them as a video. If it is none, their mean is evaluated, as for an eye that
    /// is too slow for any flicker.
    pub sub_frame_rate_hz: Option<f64>,
    /// The gaze direction, in radians of visual angle right of and below the picture's middle. The
    /// [fovea](FOVEA_DEGREES) around it is also evaluated alone.
    pub gaze: Option<[f64; 2]>,
    /// A folder for one picture per pupil of the loss in JOD ([`lost_picture`]), named `pupil-0000.png` by its index.
    pub maps: Option<&'a Path>,
}

impl JodSettings<'_> {
    /// Returns the indices of the evaluated pupils in a list of `pupils` pupils.
    pub fn places(&self, pupils: usize) -> Vec<usize> {
        let count = self.most.min(pupils);
        (0..count).map(|i| i * pupils / count).collect()
    }
}

/// Returns planes of colors with these names as one picture.
fn picture<'a>(names: &[Option<Color>], planes: &'a [Plane], black: &'a [f32]) -> Rgb<'a> {
    let named: Vec<_> = names.iter().copied().zip(planes.iter().map(|p| &p.values[..])).collect();
    rgb(&named, black)
}

/// The results of one pupil, which are the whole picture, the gaze direction alone, and the target image.
type JudgedPupil = (Judged, Option<f64>, Vec<Plane>);

/// Returns the rows and columns around the gaze direction, for a picture of `size` [rows, columns].
fn fovea([x, y]: [f64; 2], pixels_per_degree: f64, size: [usize; 2]) -> Result<[Range<usize>; 2], EvaluateError> {
    let axis = |angle: f64, pixels: usize| {
        let middle = pixels as f64 / 2.0 + angle.to_degrees() * pixels_per_degree;
        let half = FOVEA_DEGREES / 2.0 * pixels_per_degree;
        let edge = |at: f64| at.round().clamp(0.0, pixels as f64) as usize;
        edge(middle - half)..edge(middle + half)
    };
    let found = [axis(y, size[0]), axis(x, size[1])];
    if found.iter().any(|range| range.len() < LEAST) {
        let [right, below] = [x, y].map(f64::to_degrees);
        let [tall, wide] = size.map(|pixels| pixels as f64 / pixels_per_degree);
        let reason = reason!(
            "gaze-at-the-edge",
            "the gaze is {right:.1} degrees right of the middle and {below:.1} below it, with too few pixels there \
             in a picture {wide:.1} degrees wide and {tall:.1} tall. {LEAST} pixels are needed each way"
        );
        return Err(EvaluateError::Jod { reason });
    }
    Ok(found)
}

/// Returns these rows and columns of a plane.
fn cut(plane: &Plane, down: &Range<usize>, along: &Range<usize>) -> Plane {
    let rows = down.clone().flat_map(|row| &plane.values[row * plane.columns..][along.clone()]);
    Plane { rows: down.len(), columns: along.len(), values: rows.copied().collect() }
}

impl PhaseSource<'_> {
    /// Computes JOD for the pupils that [`JodSettings::places`] selects. It uses whole pictures (not averaged, unlike
    /// PSNR) at the scores' exposures, with all colors together. `observe` receives the number of finished pupils.
    /// Pupils whose colors have pictures of different sizes (holograms in tiles) get none, as do pictures that are too
    /// small or too large.
    ///
    /// # Errors
    /// Returns [`ReconstructionError::Evaluate`] for impossible settings, and the errors of
    /// [`look_through`](Self::look_through) and of writing the maps.
    pub fn judge(
        &self,
        scene: &SceneSource,
        scores: &mut HologramScores,
        settings: &JodSettings,
        engine: &mut dyn Engine,
        observe: &mut dyn FnMut(usize),
    ) -> Result<(), ReconstructionError> {
        for (done, place) in settings.places(scores.pupils.len()).into_iter().enumerate() {
            observe(done);
            let pupil = scores.pupils[place].pupil;
            let found = self.judge_pupil(scene, &pupil, &scores.exposures, settings, engine)?;
            let Some((judged, there, wanted)) = found else { continue };
            (scores.pupils[place].jod, scores.pupils[place].jod_there) = (Some(judged.jod), there);
            if let Some(folder) = settings.maps {
                let (rows, columns) = (wanted[0].rows, wanted[0].columns);
                let black = vec![0.0; rows * columns];
                let [red, green, blue] = lost_picture(&picture(&self.names(), &wanted, &black), &judged.lost);
                write_png(&folder.join(format!("pupil-{place:04}.png")), rows, columns, &[&red, &green, &blue])?;
            }
        }
        Ok(())
    }

    fn names(&self) -> Vec<Option<Color>> {
        self.about().colors.iter().map(|c| c.color).collect()
    }

    fn judge_pupil(
        &self,
        scene: &SceneSource,
        pupil: &Pupil,
        exposures: &[f64],
        settings: &JodSettings,
        engine: &mut dyn Engine,
    ) -> Result<Option<JudgedPupil>, ReconstructionError> {
        let mut wanted = Vec::new();
        for color in 0..exposures.len() {
            wanted.push(scene.photographs(color, &[*pupil], Sampling::Picture, engine)?.remove(0));
        }
        let Some(first) = wanted.first() else { return Ok(None) };
        let (rows, columns) = (first.rows, first.columns);
        let whole = self.about().picture_size();
        let share = rows as f64 / whole.0.max(1) as f64;
        let metric = JodMetric::new(&settings.viewing, settings.pixels_per_degree * share, settings.maps.is_some())?;
        let frames = match settings.sub_frame_rate_hz {
            Some(_) => (0..self.about().frames).map(Some).collect(),
            None => vec![None],
        };
        let mut seen: Vec<Vec<Plane>> = Vec::new();
        for frame in frames {
            let mut colors = Vec::new();
            for (color, exposure) in exposures.iter().enumerate() {
                let mut plane = self.look_through(color, frame, &[*pupil], Sampling::Picture, engine)?.remove(0);
                plane.values.iter_mut().for_each(|v| *v *= *exposure as f32);
                colors.push(plane);
            }
            seen.push(colors);
        }
        if wanted.iter().chain(seen.iter().flatten()).any(|p| (p.rows, p.columns) != (rows, columns)) {
            return Ok(None);
        }
        let (names, black) = (self.names(), vec![0.0; rows * columns]);
        let judge = |metric: &JodMetric, seen: &[Vec<Plane>], wanted: &[Plane], rows: usize, columns: usize| {
            let seen: Vec<Rgb> = seen.iter().map(|colors| picture(&names, colors, &black[..rows * columns])).collect();
            let target = picture(&names, wanted, &black[..rows * columns]);
            match settings.sub_frame_rate_hz {
                None => metric.picture(&seen[0], &target, rows, columns),
                Some(rate) => metric.video(&seen.repeat(SHOWN), &target, rows, columns, rate),
            }
        };
        let Some(judged) = judge(&metric, &seen, &wanted, rows, columns)? else { return Ok(None) };
        let Some(gaze) = settings.gaze else { return Ok(Some((judged, None, wanted))) };
        let [down, along] = fovea(gaze, settings.pixels_per_degree * share, [rows, columns])?;
        let cut = |planes: &Vec<Plane>| planes.iter().map(|plane| cut(plane, &down, &along)).collect();
        let (seen, target): (Vec<Vec<Plane>>, Vec<Plane>) = (seen.iter().map(cut).collect(), cut(&wanted));
        let metric = JodMetric::new(&settings.viewing, settings.pixels_per_degree * share, false)?;
        let there = judge(&metric, &seen, &target, down.len(), along.len())?.map(|there| there.jod);
        Ok(Some((judged, there, wanted)))
    }
}
