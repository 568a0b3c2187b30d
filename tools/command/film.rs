//! `eyebox film`.

use crate::Failure;
use crate::common::Engines;
use crate::live::{SubjectOptions, is_hologram, solved};
use crate::phases::tell_unfinished;
use crate::progress::{self, JobBar};
use clap::Args;
use eyebox::low_level::gpu::Options as VulkanOptions;
use eyebox::low_level::hologram::{Hologram, Opening, Sequence};
use eyebox::low_level::reason;
use eyebox::low_level::reconstruction::SceneSource;
use eyebox_lab::film::{self, Content, EyePath, FilmError, FilmSettings};
use std::path::{Path, PathBuf};

/// `eyebox film`
#[derive(Args)]
pub struct Film {
    /// NAME.zarr, a hologram or a sequence of them; NAME.npy, phases with --scene; or a scene, which is solved first
    pub what: String,
    /// Where the eye goes: a JSON file with keys, such as `{"keys": [{"t_s": 0, "x_mm": -4}, {"t_s": 2, "x_mm": 4}], "blinks_s": [1]}`
    #[arg(help_heading = "Scene", long, value_name = "FILE.json")]
    pub path: PathBuf,
    /// NAME.y4m, or a folder for one PNG a frame
    #[arg(help_heading = "Output", short, long, value_name = "OUT.y4m|OUT_DIR")]
    pub out: PathBuf,
    /// Only what the eye sees, without what it should see beside it
    #[arg(help_heading = "Output", long)]
    pub alone: bool,
    /// Pixels along each axis that become one, their mean
    #[arg(help_heading = "Output", long, default_value_t = 1, value_name = "N")]
    pub binning: usize,
    /// How it is read
    #[command(flatten)]
    pub how: SubjectOptions,
    /// One JSON object on standard output, no progress bar
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

/// Films it.
pub fn run(args: &Film) -> Result<(), Failure> {
    if args.how.experiment.printed()? {
        return Ok(());
    }
    let path = EyePath::read(&args.path).map_err(Failure::Film)?;
    if args.out.extension().is_some() && !args.out.extension().is_some_and(|e| e.eq_ignore_ascii_case("y4m")) {
        let reason = "a film is NAME.y4m, or a folder of PNGs, whose name has no ending";
        return Err(Failure::Arguments(reason!("film", "{}: {reason}", args.out.display())));
    }
    let engines = Engines::new(&args.how.engine, &VulkanOptions::default())?;
    let mut reel = Reel::open(args, &engines)?;
    let mut engine = engines.open()?;
    let settings = FilmSettings { alone: args.alone, binning: args.binning };
    progress::catch_interrupt();
    let bar = JobBar::new(args.json);
    let mut observe =
        |frame: usize, frames: usize| bar.show(&format!("frame {frame} of {frames}"), frame as f64 / frames as f64);
    let mut load = |time| reel.at(time).map_err(Ended);
    let made = film::film(&path, &settings, &mut load, &args.out, engine.as_mut(), &mut observe);
    let made = made.map_err(|Ended(failure)| failure)?;
    bar.finish();
    let made = made
        .ok_or_else(|| Failure::Arguments(reason!("stopped", "{}: stopped: nothing is written", args.out.display())))?;
    let [rows, columns] = made.size;
    if args.json {
        let report = serde_json::json!({
            "out": args.out.display().to_string(), "frames": made.frames, "looked": made.looked,
            "size": made.size, "rate_hz": path.rate_hz,
        });
        println!("{report}");
        return Ok(());
    }
    let seconds = made.frames as f64 / path.rate_hz;
    println!(
        "wrote {}: {} frames of {rows} x {columns} pixels, {seconds:.1} s; {}",
        args.out.display(),
        made.frames,
        if args.alone { "what the eye sees" } else { "left what the eye sees, right what it should" }
    );
    Ok(())
}

/// Why a film ended. [`Failure`] itself converts from errors of the library alone.
struct Ended(Failure);

impl From<FilmError> for Ended {
    fn from(error: FilmError) -> Self {
        Self(Failure::Film(error))
    }
}

/// What is filmed, by time.
struct Reel<'a> {
    args: &'a Film,
    engines: &'a Engines,
    frames: Frames,
    /// Which is shown.
    shown: Option<u64>,
}

enum Frames {
    /// One hologram, given out once.
    One(Option<Content>),
    /// Holograms that follow each other, and begin again.
    Sequence(Box<Sequence>),
}

impl<'a> Reel<'a> {
    fn open(args: &'a Film, engines: &'a Engines) -> Result<Self, Failure> {
        let path = Path::new(&args.what);
        let opening = Opening { unfinished: true, ..args.how.unit.chosen(&args.how.display)? };
        let mut reel = Self { args, engines, frames: Frames::One(None), shown: None };
        reel.frames = if Sequence::is_at(path) {
            tell_unfinished(path)?;
            Frames::Sequence(Box::new(opening.sequence(path)?))
        } else if is_hologram(path) {
            tell_unfinished(path)?;
            Frames::One(Some(reel.content(opening.hologram(path)?, path)?))
        } else {
            let (hologram, field, mut display) = solved(&args.what, &args.how, engines)?;
            display.picture = Default::default();
            let exposures = hologram.colors.iter().map(|c| c.exposure).collect();
            let scene = SceneSource::new(field, &display)?;
            Frames::One(Some(Content { source: hologram.into(), scene: Some(scene), exposures }))
        };
        Ok(reel)
    }

    /// What is to be seen at a time, where it is not what was seen before.
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

    /// A hologram with its scene.
    fn content(&self, mut hologram: Hologram, file: &Path) -> Result<Content, Failure> {
        let how = &self.args.how;
        how.eye.replace(&mut hologram.metadata.prescription)?;
        let is_unnamed = how.scene.is_none() && hologram.scene_record().is_none() && hologram.scene.is_empty();
        if self.args.alone && (is_unnamed || !hologram.metadata.exposure_assumed) {
            let exposures = hologram.colors.iter().map(|c| c.exposure).collect();
            return Ok(Content { source: hologram.into(), scene: None, exposures });
        }
        let mut input = how.other.open(file, &hologram, how.scene.as_deref(), &how.options)?;
        // What should be seen, wherever the display has to show it.
        input.display.picture = Default::default();
        let field = input.light_field()?;
        hologram.fit_exposure(&field, self.engines.open()?.as_mut())?;
        let exposures = hologram.colors.iter().map(|c| c.exposure).collect();
        Ok(Content { source: hologram.into(), scene: Some(SceneSource::new(field, &input.display)?), exposures })
    }
}
