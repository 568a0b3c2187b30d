//! A few seconds of a simulated eye that steers a hologram, as a plot and as an animation: what the demo ends with.

use super::plot;
use super::study::summary;
use crate::{Failure, progress};
use eyebox::encode::Encoder;
use eyebox::files::write_file;
use eyebox::hologram::Hologram;
use eyebox::optics::{Color, Pupil};
use eyebox::preview::{Detail, Eye, Opener, Overlay, Picture, Showing, develop, draw_overlay};
use eyebox::session::{self, Policy, SteeredColor, StudySample, StudySettings};
use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, Frame, RgbaImage};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Pixels along the longer side of each half of the animation.
const SIDE: usize = 224;
/// Every so many sets there is a picture.
const EVERY: usize = 2;

/// What was made.
pub struct Showcase {
    /// A page with plots.
    pub page: PathBuf,
    /// Steered beside unsteered, as the eye sees them.
    pub animation: PathBuf,
    /// The numbers.
    pub summary: Value,
}

/// Steers `hologram` for `seconds` of a simulated eye; nothing where the user had no patience.
pub fn showcase(
    hologram: &Hologram,
    parts: &[SteeredColor],
    encoder: &Encoder,
    mut opener: impl FnMut() -> Result<Opener, Failure>,
    engine: &str,
    seconds: f64,
    out: &Path,
) -> Result<Option<Showcase>, Failure> {
    let settings = StudySettings { seconds, ..StudySettings::default() };
    let mut film = Film::new(hologram, [opener()?, opener()?])?;
    let (mut frames, mut failed) = (Vec::new(), None);
    let mut open = opener()?;
    let result = session::study(parts, &Policy::default(), encoder, &settings, &mut open, &mut |moment, phases, _| {
        if film.count.is_multiple_of(EVERY) {
            match film.picture(moment, phases) {
                Ok(picture) => frames.push(picture),
                Err(error) => failed = Some(error),
            }
        }
        film.count += 1;
        failed.is_none() && !progress::interrupted()
    })?;
    if let Some(error) = failed {
        return Err(error);
    }
    if frames.is_empty() || progress::interrupted() {
        return Ok(None);
    }
    let animation = out.join("steered.gif");
    let delay = Delay::from_numer_denom_ms((EVERY as i64 * settings.period_ns / 1_000_000) as u32, 1);
    write_file(&animation, |file| {
        let mut encoder = GifEncoder::new_with_speed(file, 20);
        encoder.set_repeat(Repeat::Infinite).map_err(std::io::Error::other)?;
        for picture in frames {
            let [rows, columns] = picture.size;
            let rgba: Vec<u8> = picture.rgb.chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 255]).collect();
            let image = RgbaImage::from_raw(columns as u32, rows as u32, rgba)
                .ok_or_else(|| std::io::Error::other("a picture of another size"))?;
            encoder.encode_frame(Frame::from_parts(image, 0, 0, delay)).map_err(std::io::Error::other)?;
        }
        Ok(())
    })?;
    let summary = summary(&result);
    let page = out.join("steered.html");
    let title = format!("Steering {}", hologram.scene);
    write_file(&page, |file| file.write_all(plot::page(&title, engine, &result, &summary).as_bytes()))?;
    Ok(Some(Showcase { page, animation, summary }))
}

/// What the eye sees of both, side by side.
struct Film {
    /// Steered, and for the whole eyebox.
    eyes: [Eye; 2],
    showing: Showing,
    whole: Arc<Showing>,
    count: usize,
}

impl Film {
    fn new(hologram: &Hologram, [steered, whole]: [Opener; 2]) -> Result<Self, Failure> {
        let showing = Showing::new(hologram.clone(), hologram.metadata.padding())?;
        let eyes = [Eye::new(steered), Eye::new(whole)];
        Ok(Self { eyes, whole: Arc::new(showing.clone()), showing, count: 0 })
    }

    fn picture(&mut self, moment: &StudySample, phases: &[Vec<f32>]) -> Result<Picture, Failure> {
        for (color, phases) in self.showing.colors.iter_mut().zip(phases) {
            color.phases = Arc::new(phases.clone());
        }
        let whole = self.showing.size();
        let longest = whole[0].max(whole[1]).max(1);
        let size = whole.map(|n| (n * SIDE / longest).max(1));
        let pupil = Pupil { x: moment.position[0], y: moment.position[1], diameter: moment.diameter, depth: 0.0 };
        let colors: Vec<Option<Color>> = self.showing.colors.iter().map(|c| c.color).collect();
        let exposures: Vec<f64> = self.showing.colors.iter().map(|c| c.exposure).collect();
        let mut halves = Vec::new();
        let both = [(&self.showing, "steered", moment.steered_db), (&*self.whole, "unsteered", moment.whole_db)];
        for (eye, (showing, name, db)) in self.eyes.iter_mut().zip(both) {
            let planes = eye.look(showing, None, &pupil, Detail::Whole)?;
            let mut half = develop(&planes, &colors, &exposures, whole, size);
            let map = [pupil.x, pupil.y, pupil.diameter].map(|v| v / showing.eyebox);
            let line = Some(format!("{name} {db:.1} dB"));
            draw_overlay(&mut half, &Overlay { help: Vec::new(), line, map: Some(map) });
            halves.push(half);
        }
        let rgb = (0..size[0]).flat_map(|row| {
            let part = 3 * size[1] * row..3 * size[1] * (row + 1);
            halves.iter().flat_map(move |h| h.rgb[part.clone()].to_vec()).collect::<Vec<_>>()
        });
        Ok(Picture { size: [size[0], 2 * size[1]], rgb: rgb.collect() })
    }
}
