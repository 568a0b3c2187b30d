//! Takes the pictures of a bench, or reads them from a folder.

use super::bench::{Bench, CameraCommand, Event, FEWEST, ShowsPatterns};
use super::captures::{Ask, Session, Shot, load};
use super::error::CalibrateError;
use super::link::Link;
use super::message::Hello;
use super::pattern;
use eyebox_base::error::Reason;
use eyebox_base::reason;
use eyebox_optics::{Color, Display, TwoPi};
use std::path::Path;
use std::time::Duration;

/// Wavelengths that differ by more than this, nm, are different ones.
const NANOMETRES: f64 = 2.0;
/// Share of a calibration's progress that taking the pictures fills.
pub const TAKING: f64 = 0.4;

pub(super) struct CaptureSet {
    pub(super) hello: Hello,
    pub(super) shots: Vec<Shot>,
    pub(super) two_pi_level: f64,
    pub(super) waited: Duration,
    pub(super) warnings: Vec<String>,
    /// The folder of pictures that are not kept. It is deleted with this value.
    _folder: Option<tempfile::TempDir>,
}

impl CaptureSet {
    /// A set of pictures that were taken one by one or read from a folder.
    pub(super) fn of(hello: Hello, shots: Vec<Shot>, two_pi_level: f64) -> Self {
        Self { hello, shots, two_pi_level, waited: Duration::ZERO, warnings: Vec::new(), _folder: None }
    }
}

/// The gray level of a phase of 2 pi.
pub(super) fn two_pi_level(display: &Display, color: Color) -> f64 {
    let levels = f64::from(display.levels);
    match &display.encoding.two_pi_level {
        None => levels,
        Some(TwoPi::One(level)) => *level,
        Some(TwoPi::Each(each)) => each.get(&color).copied().unwrap_or(levels),
    }
}

/// Refuses a bench that does not match the display. Returns the color and the bench's wavelength of it, nm. `shows` is
/// true if the command shows the patterns.
pub(super) fn check(
    display: &Display,
    color: Color,
    hello: &Hello,
    shows: bool,
) -> Result<(Color, f64), CalibrateError> {
    let wrong = |reason: Reason| Err(CalibrateError::bench(display, reason));
    let optics = display.optics(color)?;
    if !display.geometry.is_relay() {
        return wrong(reason!(
            "far-field",
            "the display is in the far field, but calibration is for displays behind a relay"
        ));
    }
    let [rows, columns] = hello.slm.resolution;
    if [rows, columns] != [display.height, display.width] {
        let (height, width) = (display.height, display.width);
        return wrong(reason!(
            "bench-slm",
            "its SLM has {rows}x{columns} pixels, but the display file has {height}x{width}"
        ));
    }
    let pitch_um = display.pitch * 1e6;
    if let Some(theirs) = hello.slm.pitch_um.filter(|um| (um / pitch_um - 1.0).abs() > 0.01) {
        return wrong(reason!(
            "bench-pitch",
            "its pixels are {theirs} um wide, but the display file has {pitch_um} um"
        ));
    }
    let nm = optics.wavelength * 1e9;
    let Some(theirs) = hello.colors.get(&color.to_string()) else {
        let has: Vec<&str> = hello.colors.keys().map(String::as_str).collect();
        return wrong(reason!("bench-color", "it has no {color} light, only {}", has.join(", ")));
    };
    if (theirs - nm).abs() > NANOMETRES {
        return wrong(reason!(
            "bench-wavelength",
            "its {color} light has {theirs} nm, but the display file has {nm:.1} nm"
        ));
    }
    let encoding = &display.encoding;
    let plain = encoding.look_up.is_empty()
        && encoding.phases_turns.is_empty()
        && encoding.codes.is_empty()
        && encoding.cells.is_empty()
        && encoding.correction.is_empty()
        && encoding.grating.is_empty()
        && encoding.rotation_deg == 0
        && encoding.offset_px == [0; 2]
        && !encoding.flip.mirrors()
        && !encoding.flip.overturns();
    if shows && !plain && !hello.slm.takes.iter().any(|kind| kind == "phases") {
        return wrong(reason!(
            "levels-alone",
            "it takes levels only, but the encoding of the display file is more than levels. Use a command that \
             takes phases and converts them to the input of the SLM"
        ));
    }
    Ok((color, *theirs))
}

pub(super) fn take(
    display: &Display,
    color: Color,
    bench: &Bench,
    shows: Option<&mut dyn ShowsPatterns>,
    tell: &dyn Fn(Event),
) -> Result<CaptureSet, CalibrateError> {
    let Bench::Command { camera: CameraCommand { command, keep, limit, iris_mm }, most, quick } = *bench else {
        return Err(reason!("folder-takes-none", "a folder cannot take pictures. Give a camera's command").into());
    };
    if most < FEWEST && !quick {
        return Err(reason!("too-few", "{most} pictures are too few. A calibration takes at least {FEWEST}").into());
    }
    tell(Event::At("starting the camera's command", 0.0));
    let mut say = |line: &str| tell(Event::Said(line));
    let (link, mut hello) = Link::start(command, limit, &mut say)?;
    let named = check(display, color, &hello, shows.is_none())?;
    let (optics, two_pi_level) = (display.optics(color)?, two_pi_level(display, color));
    let size = [display.height, display.width];
    let mut session = Session::new(link, hello.clone(), keep, named, most)?;
    if let Some(shows) = shows {
        hello.slm.sub_frames = shows.sub_frames();
        session.shows = Some(shows);
    }
    let mut warnings = Vec::new();
    let mut shots = session.take_first(display, &pattern::dots_pattern(size, two_pi_level), iris_mm)?;
    let shows = pattern::plan(&hello, &optics, two_pi_level, most, quick);
    let all: usize = shows.iter().map(|s| s.irises_mm.len() * s.times).sum();
    let mut done = 0;
    for show in &shows {
        for iris in &show.irises_mm {
            for _ in 0..show.times {
                tell(Event::At(&format!("picture {} of {}", done + 3, all + 2), TAKING * done as f64 / all as f64));
                let ask = Ask { show: Some((&show.name, &show.pattern)), iris_mm: *iris, focus_mm: 0.0 };
                shots.extend(session.take(&ask)?);
                done += 1;
            }
        }
    }
    session.end();
    if !session.left_out.is_empty() {
        warnings.push(format!("{} pictures were left out ({})", session.left_out.len(), session.left_out.join("; ")));
    }
    stand(&mut shots, iris_mm);
    Ok(CaptureSet { hello, shots, two_pi_level, waited: session.waited, warnings, _folder: session.into_folder() })
}

/// Sets `iris_mm` of each picture that does not state the place of its iris.
fn stand(shots: &mut [Shot], iris_mm: Option<[f64; 3]>) {
    shots.iter_mut().for_each(|shot| shot.iris_mm = shot.iris_mm.or(iris_mm));
}

pub(super) fn read(
    display: &Display,
    color: Color,
    folder: &Path,
    iris_mm: Option<[f64; 3]>,
) -> Result<CaptureSet, CalibrateError> {
    let (hello, captures) = load(folder)?;
    check(display, color, &hello, captures.iter().all(|c| c.shown.is_none()))?;
    let name = color.to_string();
    let shots = captures
        .iter()
        .filter(|c| c.request.color.as_ref().is_none_or(|c| *c == name))
        .filter_map(|c| c.shot(folder))
        .collect::<Result<Vec<_>, Reason>>();
    let mut shots = shots.map_err(|reason| CalibrateError::captures(folder, reason))?;
    stand(&mut shots, iris_mm);
    let two_pi_level = two_pi_level(display, color);
    Ok(CaptureSet::of(hello, shots, two_pi_level))
}
