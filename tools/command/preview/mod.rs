//! `eyebox preview` shows the image that an eye sees in a window.

mod args;
mod sequence;

pub use args::Preview;

use crate::args::scene_of;
use crate::common::{self, Engines, Form};
use crate::phases::tell_unfinished;
use crate::render::picture;
use crate::{Failure, progress, subject};
use eyebox::low_level::error::Reason;
use eyebox::low_level::evaluate::Plane;
use eyebox::low_level::gpu::Options;
use eyebox::low_level::hologram::{Hologram, Opening, PhaseSource, Sequence, Tiles};
use eyebox::low_level::optics::{Color, Obstruction, Padding, Prescription, Pupil};
use eyebox::low_level::present::{Desktop, Monitor, PresentError, WindowEvent};
use eyebox::low_level::preview::{
    Action, Controls, Look, Picture, PreviewContent, PreviewError, PreviewWindow, RenderedView, Side, Viewer, places,
};
use eyebox::low_level::reason;
use eyebox::low_level::reconstruction::SceneSource;
use sequence::Playing;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Longest time between two checks for a new picture.
const PUMP_EVERY: Duration = Duration::from_millis(8);
/// Limits of the longer side of a window without a chosen size, pixels.
const USUAL: [f64; 2] = [640.0, 1280.0];
/// The share of a monitor that such a window may take.
const ROOM: f64 = 0.85;

/// Shows the window until it is closed.
pub fn run(args: &Preview) -> Result<(), Failure> {
    if args.how.experiment.printed(&[])? {
        return Ok(());
    }
    let opened = if args.is_hologram() { Some(open(args)?) } else { None };
    // The desktop opens before anything is computed, so that a missing window is reported at once.
    let mut desktop = Desktop::open()?;
    let engines = Engines::new(&args.how.engine, &Options::default())?;
    let Opened { hologram, pupil, playing, tiles, scene } = match opened {
        Some(opened) => Opened { scene: scene(args, &opened)?, ..opened },
        None => solved(args, &engines)?,
    };
    let hologram = expose(args, hologram, &pupil, &engines)?;
    let colors: Vec<Option<Color>> = hologram.colors.iter().map(|c| c.color).collect();
    let size = hologram.picture_size().into();
    let window = window_size(args, size, &desktop);
    let mut shown = PreviewedContent {
        name: Path::new(&args.what).file_name().map_or_else(|| "phases".into(), |n| n.to_string_lossy().into_owned()),
        rate: playing.as_ref().map_or(1.0, |p| p.1),
        playing: playing.map(|p| p.0),
        padding: hologram.metadata.padding(),
        prescription: hologram.metadata.prescription.clone(),
        obstruction: hologram.metadata.obstruction,
        exposure: args.exposure,
        index: 0,
        contents: 0,
        colors,
        size,
        folder: args.out.clone(),
    };
    let mut showing = PreviewContent::new(hologram, shown.padding)?;
    showing.tiles = tiles;
    let showing = Arc::new(showing);
    let controls = Controls::new(&showing, pupil, !scene.is_empty(), shown.playing.is_some());
    let mut viewer = Viewer::start(engines.opener(), scene)?;
    let gpu = common::display_gpu(&args.how.engine.device, args.validation)?;
    let messages = gpu.messages();
    let mut window = PreviewWindow::open(&gpu, &mut desktop, &shown.name, window)?;
    drop(gpu);
    progress::catch_interrupt();
    shown.show(&mut viewer, showing);
    let ended = watch(&mut desktop, &mut window, &mut viewer, controls, &mut shown);
    drop(viewer);
    drop(window);
    let messages = messages.lock().map(|m| m.clone()).unwrap_or_default();
    messages.iter().for_each(|m| eprintln!("validation: {m}"));
    if ended.is_ok() && !messages.is_empty() {
        return Err(Failure::Arguments(reason!(
            "validation",
            "the validation layer found {} faults, above",
            messages.len()
        )));
    }
    ended
}

struct Opened {
    /// The hologram that is shown first. A hologram in tiles has no phases here.
    hologram: Hologram,
    pupil: Pupil,
    /// The sequence that continues from there, with its rate.
    playing: Option<(Playing, f64)>,
    /// The tiles, which keep the phases.
    tiles: Option<Arc<Tiles>>,
    /// The scene of the target image, which has no colors if there is none.
    scene: SceneSource,
}

impl Opened {
    /// Makes content without a scene.
    fn new(
        args: &Preview,
        hologram: Hologram,
        playing: Option<(Playing, f64)>,
        tiles: Option<Arc<Tiles>>,
    ) -> Result<Self, Failure> {
        let pupil = common::pupil_of(&args.pupil, &hologram, args.how.display.force)?;
        Ok(Self { hologram, pupil, playing, tiles, scene: SceneSource::Whole(Vec::new()) })
    }
}

/// Opens a hologram, a sequence or bare phases, without a scene.
fn open(args: &Preview) -> Result<Opened, Failure> {
    args.how.options.check(args.how.scene.as_ref())?;
    subject::refuse_quality(&args.what, &args.how)?;
    let (file, phases) = (Path::new(&args.what), args.phases());
    if args.which.at.is_none() && !args.encoded.encoded && Sequence::is_at(file) {
        if args.how.scene.is_some() {
            return Err(Failure::Arguments(reason!(
                "scene-of-sequence",
                "--scene is the scene of one hologram, and a sequence has many. Choose one with --at"
            )));
        }
        tell_unfinished(file)?;
        let opening = Opening { unfinished: true, ..phases.opening(file, args.which.at)? };
        let mut sequence = opening.sequence(file)?;
        let [numerator, denominator] = sequence.rate();
        let hz = args.rate.map_or(f64::from(numerator) / f64::from(denominator), |rate| rate.hz());
        let mut hologram = sequence.load(0)?;
        args.how.eye.replace(&mut hologram.metadata.prescription)?;
        hologram.metadata.obstruction = args.obstructions.obstructed;
        return Opened::new(args, hologram, Some((Playing::new(sequence, hz)?, hz)), None);
    }
    let source = args.encoded.source(&phases, file, args.which.at)?;
    let source = match args.how.eye.given()? {
        Some(eye) => source.seen_by(Some(eye))?,
        None => source,
    };
    let source = source.obstructed(args.obstructions.obstructed);
    let hologram = source.about().clone();
    let tiles = match source {
        PhaseSource::Whole(_) => None,
        PhaseSource::Tiled(tiles) => Some(tiles),
    };
    Opened::new(args, hologram, None, tiles)
}

/// Solves a scene, which is also the scene of the target image.
fn solved(args: &Preview, engines: &Engines) -> Result<Opened, Failure> {
    let given = [
        (args.which.at.is_some(), "--at"),
        (args.rate.is_some(), "--rate"),
        (args.encoded.as_shown.is_some(), "--as-shown"),
    ];
    if let Some((_, option)) = given.into_iter().find(|(given, _)| *given) {
        let what = &args.what;
        return Err(Failure::Arguments(reason!("of-holograms", "{option} is for a hologram, and {what} is a scene")));
    }
    let (mut hologram, field, mut display) = subject::solved(&args.what, &args.how, engines)?;
    hologram.metadata.obstruction = args.obstructions.obstructed;
    // The target is what an eye should see, wherever the display shows it.
    display.picture = Default::default();
    Ok(Opened { scene: SceneSource::new(field, &display)?, ..Opened::new(args, hologram, None, None)? })
}

/// Sets one exposure for the whole session. It is the requested one, or the hologram's own if it is known. Otherwise
/// the 99th percentile of the first picture becomes white.
fn expose(args: &Preview, mut hologram: Hologram, pupil: &Pupil, engines: &Engines) -> Result<Hologram, Failure> {
    let exposures = match (args.exposure, hologram.metadata.exposure_assumed) {
        (Some(exposure), _) => vec![exposure; hologram.colors.len()],
        (None, false) => return Ok(hologram),
        (None, true) => {
            let planes = hologram.look(pupil, engines.open()?.as_mut())?;
            picture::exposures(&hologram, None, &planes)
        }
    };
    hologram.colors.iter_mut().zip(exposures).for_each(|(color, exposure)| color.exposure = exposure);
    Ok(hologram)
}

/// Loads the scene of `--scene` before the hologram's display, or the scene that the hologram was solved from if it can
/// be read.
fn scene(args: &Preview, opened: &Opened) -> Result<SceneSource, Failure> {
    let how = &args.how;
    if opened.playing.is_some() {
        // A sequence has one scene per hologram.
        return Ok(SceneSource::Whole(Vec::new()));
    }
    let load = || -> Result<SceneSource, Failure> {
        let given = how.scene.as_deref();
        let file = Path::new(&args.what);
        let input = scene_of(file, &opened.hologram, given, &how.options, how.display.force)?;
        if opened.tiles.is_some() {
            return Ok(SceneSource::Around(input.around()?));
        }
        Ok(SceneSource::new(input.light_field()?, &input.display)?)
    };
    match load() {
        Err(failure) if how.scene.is_none() => {
            tracing::info!("{}: no target image: {failure}", args.what);
            Ok(SceneSource::Whole(Vec::new()))
        }
        loaded => loaded,
    }
}

/// Returns the rows and columns of the window's inside.
fn window_size(args: &Preview, size: [usize; 2], desktop: &Desktop) -> [usize; 2] {
    let times = |zoom: f64| size.map(|n| ((n as f64 * zoom).round() as usize).clamp(1, 16384));
    match (args.window, args.zoom) {
        (Some(window), _) => window,
        (None, Some(zoom)) => times(zoom),
        (None, None) => {
            let longer = size[0].max(size[1]) as f64;
            // Small pictures are magnified by a whole number.
            let usual = if longer < USUAL[0] { (USUAL[0] / longer).floor() } else { (USUAL[1] / longer).min(1.0) };
            let room =
                |m: &Monitor| (ROOM * m.size[0] as f64 / size[0] as f64).min(ROOM * m.size[1] as f64 / size[1] as f64);
            let most = desktop.monitors().iter().map(room).fold(f64::NEG_INFINITY, f64::max);
            times(if most > 0.0 { usual.min(most) } else { usual })
        }
    }
}

/// The content of the window and its properties.
struct PreviewedContent {
    name: String,
    playing: Option<Playing>,
    rate: f64,
    padding: Padding,
    prescription: Option<Prescription>,
    obstruction: Option<Obstruction>,
    exposure: Option<f64>,
    index: u64,
    contents: u64,
    colors: Vec<Option<Color>>,
    size: [usize; 2],
    folder: PathBuf,
}

impl PreviewedContent {
    fn show(&mut self, viewer: &mut Viewer, showing: Arc<PreviewContent>) {
        viewer.show(showing);
        self.contents += 1;
    }

    /// Continues with the sequence. `seen` is the number of the content that was seen last.
    fn go_on(&mut self, viewer: &mut Viewer, seen: u64) -> Result<(), Failure> {
        let Some(playing) = &mut self.playing else { return Ok(()) };
        let (index, mut hologram) = match playing.next(self.index, seen == self.contents) {
            Ok(None) => return Ok(()),
            Ok(Some(next)) => next,
            // A damaged hologram is reported and left out, and the one before stays.
            Err(Failure::Library(eyebox::Error::Hologram(error))) => {
                eprintln!("note: {error}");
                return Ok(());
            }
            Err(error) => return Err(error),
        };
        if let Some(exposure) = self.exposure {
            hologram.colors.iter_mut().for_each(|c| c.exposure = exposure);
        }
        self.index = index;
        hologram.metadata.prescription.clone_from(&self.prescription);
        hologram.metadata.obstruction = self.obstruction;
        let showing = PreviewContent::new(hologram, self.padding)?;
        self.show(viewer, Arc::new(showing));
        Ok(())
    }

    fn title(&self, controls: &Controls, seen: &RenderedView) -> String {
        let Self { name, playing, index, .. } = self;
        let which = playing.as_ref().map_or(String::new(), |p| format!(", hologram {} of {}", index + 1, p.count()));
        format!("{name}{which}: {}. h: help", controls.describe(seen))
    }

    /// Writes the picture with the sampling of the simulation, as `eyebox render` does.
    fn save(&self, seen: &RenderedView) -> Result<Vec<PathBuf>, Failure> {
        let stem = Path::new(&self.name).file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
        let free = |ending: &str| {
            let name = |i: usize| self.folder.join(format!("{stem}-{ending}-{i}.png"));
            (1..).map(name).find(|f| !f.exists()).unwrap_or_else(|| name(0))
        };
        let mut written = Vec::new();
        let mut write = |ending: &str, planes: &[Plane], exposures: &[f64]| {
            if planes.is_empty() {
                return Ok(());
            }
            let file = free(ending);
            common::write_image(&file, Form::Png, planes, &self.colors, exposures)?;
            written.push(file);
            Ok::<(), Failure>(())
        };
        write("seen", &seen.planes, &seen.exposures)?;
        if seen.look.side != Side::Seen {
            write("wanted", &seen.wanted, &vec![1.0; self.colors.len()])?;
        }
        Ok(written)
    }
}

/// Handles events and draws until the window is closed.
fn watch(
    desktop: &mut Desktop,
    window: &mut PreviewWindow,
    viewer: &mut Viewer,
    mut controls: Controls,
    shown: &mut PreviewedContent,
) -> Result<(), Failure> {
    let (mut asked, mut seen): (Option<Look>, Option<RenderedView>) = (None, None);
    let (mut save, mut drawn) = (false, None);
    loop {
        desktop.pump_for(PUMP_EVERY).map_err(lost)?;
        let mut draw = false;
        while let Some(event) = window.event() {
            let at = places(window.size(), shown.size, controls.count());
            match controls.take(event, &at) {
                Some(Action::Close) => return Ok(()),
                Some(Action::Save) => save = true,
                Some(Action::Pause) => {
                    let (index, rate) = (shown.index, shown.rate);
                    shown.playing.iter_mut().for_each(|p| p.pause(index, rate));
                }
                Some(Action::Step(by)) => {
                    let index = shown.index;
                    shown.playing.iter_mut().for_each(|p| p.step(index, by));
                }
                None => {}
            }
            draw |= matches!(event, WindowEvent::Resized(_));
        }
        if progress::interrupted() {
            return Ok(());
        }
        shown.go_on(viewer, seen.as_ref().map_or(0, |s| s.content))?;
        // A minimized window needs no picture.
        if window.size() != [0, 0] {
            let place = places(window.size(), shown.size, controls.count())[0];
            let (frame, side) = (controls.alone(), controls.side);
            let look = Look { pupil: controls.pupil, frame, side, within: [place.height, place.width] };
            if asked != Some(look) {
                viewer.look(look);
                asked = Some(look);
            }
        }
        if let Some(new) = viewer.newest()? {
            window.title(&shown.title(&controls, &new));
            if save && new.whole && Some(new.look) == asked {
                keep(shown, &new);
                save = false;
            }
            seen = Some(new);
            draw = true;
        } else if let Some(seen) = seen.as_ref().filter(|s| save && s.whole && Some(s.look) == asked) {
            keep(shown, seen);
            save = false;
        }
        let overlay = controls.overlay(seen.as_ref());
        if draw || drawn.as_ref() != Some(&overlay) {
            let pictures: Vec<&Picture> = match &seen {
                None => Vec::new(),
                Some(s) => match (s.look.side, &s.photograph) {
                    (Side::Photograph, Some(photograph)) => vec![photograph],
                    (Side::Both, Some(photograph)) => vec![&s.seen, photograph],
                    _ => vec![&s.seen],
                },
            };
            let at = places(window.size(), shown.size, pictures.len());
            window.show(&at.into_iter().zip(pictures).collect::<Vec<_>>(), &overlay);
            drawn = Some(overlay);
        }
        window.refresh().map_err(gone)?;
    }
}

/// Writes the picture and prints its file or the error. A full disk does not close the window.
fn keep(shown: &PreviewedContent, seen: &RenderedView) {
    match shown.save(seen) {
        Ok(files) => files.iter().for_each(|f| eprintln!("wrote {}", f.display())),
        Err(error) => eprintln!("note: {error}"),
    }
}

/// Returns the failure with its own exit code for a desktop that went away while it showed the window.
fn lost(error: PresentError) -> Failure {
    Failure::Lost(Reason::new("display", error))
}

fn gone(error: PreviewError) -> Failure {
    Failure::Lost(reason!("window", "the preview's window: {error}"))
}
