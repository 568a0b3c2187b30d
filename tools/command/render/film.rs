//! `eyebox render --path` renders a film of the images that an eye sees along a path.

use super::args::{Render, RenderedContent};
use super::picture::target_display;
use crate::Failure;
use crate::args::{SceneArgs, scene_of};
use crate::common::{self, Engines};
use crate::phases::tell_unfinished;
use crate::progress::{self, JobBar};
use crate::subject::{self, solved};
use crate::talk::print_report;
use eyebox::low_level::gpu::Options as VulkanOptions;
use eyebox::low_level::hologram::{ColorHologram, Hologram, Opening, Sequence};
use eyebox::low_level::optics::Color;
use eyebox::low_level::reason;
use eyebox::low_level::reconstruction::SceneSource;
use eyebox_lab::film::{self, Content, EyePath, FilmContent, FilmError, FilmSettings};
use std::path::Path;

/// Renders the film along a path.
pub fn run(args: &Render, path: &Path) -> Result<(), Failure> {
    let path = EyePath::read(path).map_err(Failure::Film)?;
    if args.out.extension().is_some() && !args.out.extension().is_some_and(|e| e.eq_ignore_ascii_case("y4m")) {
        let reason = "a film is NAME.y4m, or a folder of PNGs, whose name has no ending";
        return Err(Failure::Arguments(reason!("film", "{}: {reason}", args.out.display())));
    }
    let engines = Engines::new(&args.how.engine, &VulkanOptions::default())?;
    let mut reel = Reel::open(args, &engines)?;
    let mut engine = engines.open()?;
    let rendered = args.content.unwrap_or(RenderedContent::Both);
    let content = match rendered {
        RenderedContent::Image => FilmContent::Image,
        RenderedContent::Target => FilmContent::Target,
        RenderedContent::Both => FilmContent::Both,
    };
    let settings = FilmSettings { content, binning: args.binning };
    progress::catch_interrupt();
    let bar = JobBar::new(args.json);
    let mut observe =
        |frame: usize, frames: usize| bar.show(&format!("frame {frame} of {frames}"), frame as f64 / frames as f64);
    let mut load = |time| reel.at(time).map_err(Ended);
    let made = film::film(&path, &settings, &mut load, &args.out, engine.as_mut(), &mut observe);
    let made = made.map_err(|Ended(failure)| failure)?;
    bar.finish();
    let made = made.ok_or_else(|| {
        Failure::Arguments(reason!("stopped", "{}: stopped, and nothing is written", args.out.display()))
    })?;
    let [rows, columns] = made.size;
    if args.json {
        let report = serde_json::json!({
            "out": args.out.display().to_string(), "frames": made.frames, "looked": made.looked,
            "size": made.size, "rate_hz": path.rate_hz,
        });
        print_report(report);
        return Ok(());
    }
    let seconds = made.frames as f64 / path.rate_hz;
    println!(
        "wrote {}: {} frames of {rows} x {columns} pixels, {seconds:.1} s; {}",
        args.out.display(),
        made.frames,
        rendered.in_words()
    );
    Ok(())
}

/// The failure that ended a film. [`Failure`] itself converts from errors of the library alone.
struct Ended(Failure);

impl From<FilmError> for Ended {
    fn from(error: FilmError) -> Self {
        Self(Failure::Film(error))
    }
}

/// The content of a film by time.
struct Reel<'a> {
    args: &'a Render,
    engines: &'a Engines,
    frames: Frames,
    /// The number of the hologram that is shown.
    shown: Option<u64>,
}

enum Frames {
    /// One hologram, which is returned once.
    One(Option<Content>),
    /// Holograms that follow each other, and begin again.
    Sequence(Box<Sequence>),
}

impl<'a> Reel<'a> {
    fn open(args: &'a Render, engines: &'a Engines) -> Result<Self, Failure> {
        let path = Path::new(&args.what);
        let opening = Opening { unfinished: true, ..args.how.unit.chosen(&args.how.display)? };
        if Sequence::is_at(path) || args.is_hologram() {
            subject::refuse_quality(&args.what, &args.how)?;
        }
        let mut reel = Self { args, engines, frames: Frames::One(None), shown: None };
        reel.frames = if Sequence::is_at(path) {
            tell_unfinished(path)?;
            Frames::Sequence(Box::new(opening.sequence(path)?))
        } else if args.is_hologram() {
            tell_unfinished(path)?;
            Frames::One(Some(reel.content(opening.hologram(path)?, path)?))
        } else if args.content == Some(RenderedContent::Target) {
            Frames::One(Some(target(args, engines)?))
        } else {
            let (hologram, field, mut display) = solved(&args.what, &args.how, engines)?;
            display.picture = Default::default();
            let exposures = hologram.colors.iter().map(|c| c.exposure).collect();
            let scene = SceneSource::new(field, &display)?;
            Frames::One(Some(Content { source: hologram.into(), scene: Some(scene), exposures }))
        };
        Ok(reel)
    }

    /// Returns the content at a time, if it differs from the content before.
    fn at(&mut self, time: f64) -> Result<Option<Content>, Failure> {
        let hologram = match &mut self.frames {
            Frames::One(content) => return Ok(content.take()),
            Frames::Sequence(sequence) => {
                let [holograms, seconds] = sequence.rate().map(f64::from);
                let due = (time * holograms / seconds + 1e-6) as u64 % sequence.count().max(1);
                if self.shown.replace(due) == Some(due) {
                    return Ok(None);
                }
                sequence.load(due)?
            }
        };
        self.content(hologram, Path::new(&self.args.what)).map(Some)
    }

    /// Returns a hologram with its scene.
    fn content(&self, mut hologram: Hologram, file: &Path) -> Result<Content, Failure> {
        let how = &self.args.how;
        how.eye.replace(&mut hologram.metadata.prescription)?;
        let is_unnamed = how.scene.is_none() && hologram.scene_record().is_none() && hologram.scene.is_empty();
        if self.args.content == Some(RenderedContent::Image) && (is_unnamed || !hologram.metadata.exposure_assumed) {
            let exposures = hologram.colors.iter().map(|c| c.exposure).collect();
            return Ok(Content { source: hologram.into(), scene: None, exposures });
        }
        let mut input = scene_of(file, &hologram, how.scene.as_deref(), &how.options, how.display.force)?;
        // The target is what an eye should see, wherever the display shows it.
        input.display.picture = Default::default();
        let mut engine = self.engines.open()?;
        let input = input.drawn_by(engine.as_ref());
        let field = input.light_field()?;
        hologram.fit_exposure(&field, engine.as_mut())?;
        let exposures = hologram.colors.iter().map(|c| c.exposure).collect();
        Ok(Content { source: hologram.into(), scene: Some(SceneSource::new(field, &input.display)?), exposures })
    }
}

/// Opens a scene of which only the target image is filmed, so that nothing is solved. Its hologram is never looked at.
fn target(args: &Render, engines: &Engines) -> Result<Content, Failure> {
    let (display, colors) = target_display(args)?;
    let scene = SceneArgs::new(&args.what, &args.how.options);
    let field = common::scene_on(&scene, &display, &colors, engines.open()?.as_ref())?;
    let dark = |color: &Color| -> Result<ColorHologram, Failure> {
        let wavelength = display.optics(*color)?.wavelength;
        Ok(ColorHologram { color: Some(*color), wavelength, exposure: 1.0, efficiency: 1.0, phases: Vec::new() })
    };
    let colors = colors.iter().map(dark).collect::<Result<Vec<_>, _>>()?;
    let exposures = vec![1.0; colors.len()];
    let hologram = Hologram::on(&display, 1, colors);
    Ok(Content { source: hologram.into(), scene: Some(SceneSource::new(field, &display)?), exposures })
}
