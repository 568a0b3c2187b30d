//! What people see of the difference between a hologram and its scene, through some of many pupils.

use super::{HologramError, HologramScores, PhaseSource, Sampling, SceneSource};
use crate::engine::Engine;
use crate::evaluate::{JodMetric, Judged, Plane, Rgb, lost_picture, rgb};
use crate::files::{FileError, write_png};
use crate::optics::{Color, Pupil, Viewing};
use std::path::Path;

/// Times that sub-frames are shown in the video that is judged: what repeats shows in the second.
const SHOWN: usize = 2;

/// How a hologram is judged by ColorVideoVDP.
#[derive(Debug, Clone, Copy)]
pub struct JodSettings<'a> {
    /// How bright and how fine the picture is seen.
    pub viewing: Viewing,
    /// Pixels a degree of the display's own picture ([`Display::pixels_per_degree`](crate::optics::Display::pixels_per_degree)).
    pub pixels_per_degree: f64,
    /// Of how many pupils, spread evenly over the list: a judgement takes longer than a look.
    pub most: usize,
    /// Sub-frames a second: they are judged as the video that they are. None: their mean is, as of an eye that is too slow
    /// for all flicker.
    pub sub_frame_rate_hz: Option<f64>,
    /// A folder for one picture a pupil of where JOD are lost ([`lost_picture`]), `pupil-0000.png` by its place in the list.
    pub maps: Option<&'a Path>,
}

impl JodSettings<'_> {
    /// Places of the pupils that are judged, of so many.
    pub fn places(&self, pupils: usize) -> Vec<usize> {
        let count = self.most.min(pupils);
        (0..count).map(|i| i * pupils / count).collect()
    }
}

/// Planes of colours of these names as one picture.
fn picture<'a>(names: &[Option<Color>], planes: &'a [Plane], black: &'a [f32]) -> Rgb<'a> {
    let named: Vec<_> = names.iter().copied().zip(planes.iter().map(|p| &p.values[..])).collect();
    rgb(&named, black)
}

impl PhaseSource<'_> {
    /// Puts JOD to those of the scores' pupils that [`JodSettings::places`] names, of whole pictures (not averaged, as PSNR's
    /// are) at the scores' exposures, all colours together; `observe` is told how many are judged. Pupils whose colours have pictures
    /// of different sizes (holograms in tiles), and pictures too small or too large to be judged, have none.
    ///
    /// # Errors
    /// [`HologramError::Evaluate`] for settings that cannot be; those of [`look_through`](Self::look_through) and of the
    /// files of maps.
    pub fn judge(
        &self,
        scene: &SceneSource,
        scores: &mut HologramScores,
        settings: &JodSettings,
        engine: &mut dyn Engine,
        observe: &mut dyn FnMut(usize),
    ) -> Result<(), HologramError> {
        for (done, place) in settings.places(scores.pupils.len()).into_iter().enumerate() {
            observe(done);
            let pupil = scores.pupils[place].pupil;
            let Some((judged, wanted)) = self.judge_pupil(scene, &pupil, &scores.exposures, settings, engine)? else {
                continue;
            };
            scores.pupils[place].jod = Some(judged.jod);
            if let Some(folder) = settings.maps {
                self.write_map(&folder.join(format!("pupil-{place:04}.png")), &judged, &wanted)?;
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
    ) -> Result<Option<(Judged, Vec<Plane>)>, HologramError> {
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
        let seen: Vec<Rgb> = seen.iter().map(|colors| picture(&names, colors, &black)).collect();
        let target = picture(&names, &wanted, &black);
        let judged = match settings.sub_frame_rate_hz {
            None => metric.picture(&seen[0], &target, rows, columns)?,
            Some(rate) => metric.video(&seen.repeat(SHOWN), &target, rows, columns, rate)?,
        };
        Ok(judged.map(|judged| (judged, wanted)))
    }

    fn write_map(&self, file: &Path, judged: &Judged, wanted: &[Plane]) -> Result<(), FileError> {
        let (rows, columns) = (wanted[0].rows, wanted[0].columns);
        let black = vec![0.0; rows * columns];
        let [red, green, blue] = lost_picture(&picture(&self.names(), wanted, &black), &judged.lost);
        write_png(file, rows, columns, &[&red, &green, &blue])
    }
}
