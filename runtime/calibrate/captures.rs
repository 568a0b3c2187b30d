//! Takes and keeps the pictures of a bench, one after the other.
//!
//! They come from a camera's command, from an earlier run that was interrupted, or from a folder alone.

use super::bench::ShowsPatterns;
use super::error::CalibrateError;
use super::link::Link;
use super::message::{Answer, Hello, Request, Show};
use super::pattern::{self, Pattern};
use super::picture::{self, Picture};
use eyebox_base::error::Reason;
use eyebox_base::files::{self, FileError, read, write_file};
use eyebox_base::reason;
use eyebox_optics::{Color, Display};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

pub(super) const DOCUMENT: &str = "captures.json";
/// A shorter exposure is requested if more than this share of the pixels is saturated.
const SATURATED: f64 = 0.01;
/// Number of requests of a picture with shorter and shorter exposures.
const SHORTER: usize = 3;
/// Number of pictures that the bench adds for each request.
const AVERAGE: usize = 4;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Capture {
    pub(super) request: Request,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) answer: Option<serde_json::Value>,
    /// The pattern that a display of this machine showed. The command was not requested to show it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) shown: Option<Show>,
}

impl Capture {
    /// The pattern that the SLM showed, or none in the dark.
    fn show(&self) -> Option<&Show> {
        self.shown.as_ref().or(self.request.show.as_ref())
    }

    /// The picture, if there is one. Files are in `folder`. The error states the problem of its answer.
    pub(super) fn shot(&self, folder: &Path) -> Option<Result<Shot, Reason>> {
        let answer = self.answer.as_ref().filter(|a| a.get("error").is_none())?;
        Some(Answer::read(answer).map(|answer| shot_of(folder, self.show(), &self.request, &answer)))
    }
}

#[derive(Serialize, Deserialize)]
struct Document {
    protocol: u64,
    hello: Hello,
    captures: Vec<Capture>,
}

/// A request of a pattern through an iris. The default is darkness.
#[derive(Debug, Clone, Default)]
pub(super) struct Ask<'p> {
    /// Name and pattern, or none for darkness.
    pub(super) show: Option<(&'p str, &'p Pattern)>,
    /// Place x, y and diameter of the iris, mm.
    pub(super) iris_mm: Option<[f64; 3]>,
    pub(super) focus_mm: f64,
}

#[derive(Debug, Clone)]
pub(super) struct Shot {
    /// The file of the pattern, and its kind.
    pub(super) show: Option<(PathBuf, String)>,
    pub(super) file: PathBuf,
    pub(super) full_scale: f64,
    pub(super) exposure_ms: f64,
    pub(super) iris_mm: Option<[f64; 3]>,
    pub(super) focus_mm: f64,
}

impl Shot {
    pub(super) fn picture(&self, camera: [usize; 2]) -> Result<Picture, CalibrateError> {
        picture_of(&self.file, self.full_scale, camera)
    }
}

/// Reads the picture in a file of the camera's size (rows, columns).
pub(super) fn picture_of(file: &Path, full_scale: f64, camera: [usize; 2]) -> Result<Picture, CalibrateError> {
    picture::load(file, camera, full_scale).map_err(|reason| CalibrateError::captures(file, reason))
}

/// The source of the pictures, and the captures of this run.
pub(super) struct Session<'a> {
    link: Option<Link<'a>>,
    folder: PathBuf,
    temporary: Option<tempfile::TempDir>,
    pub(super) hello: Hello,
    taken: Vec<Capture>,
    /// Captures of an earlier run, in their order.
    before: VecDeque<Capture>,
    pub(super) color: (Color, f64),
    most: usize,
    /// The requested exposure, if the bench does not choose it.
    pub(super) exposure_ms: Option<f64>,
    /// Time spent in waiting for the camera.
    pub(super) waited: Duration,
    /// The errors of the bench, in its own words.
    pub(super) left_out: Vec<String>,
    /// The display that shows the patterns, if the command does not.
    pub(super) shows: Option<&'a mut dyn ShowsPatterns>,
}

/// Reads the abilities of the bench and its pictures from a folder of captures.
pub(super) fn load(folder: &Path) -> Result<(Hello, Vec<Capture>), CalibrateError> {
    let file = folder.join(DOCUMENT);
    let text = read::text(&file, read::TABLE).map_err(|e| FileError::read(&file, e))?;
    let wrong = |reason: Reason| CalibrateError::captures(&file, reason);
    let read: Document = serde_json::from_str(&text).map_err(|e| wrong(e.to_string().into()))?;
    let hello = serde_json::to_value(&read.hello).map_err(|e| wrong(e.to_string().into()))?;
    Ok((Hello::read(&hello).map_err(wrong)?, read.captures))
}

impl<'a> Session<'a> {
    /// A session with a camera's command. Pictures go to `keep`. Pictures that are already there are not requested
    /// again. `color` is the color and the bench's wavelength of it, nm.
    pub(super) fn new(
        link: Link<'a>,
        hello: Hello,
        keep: Option<&Path>,
        color: (Color, f64),
        most: usize,
    ) -> Result<Self, CalibrateError> {
        let temporary = match keep {
            Some(_) => None,
            None => Some(tempfile::tempdir().map_err(|e| FileError::write(&std::env::temp_dir(), e))?),
        };
        let folder = temporary.as_ref().map_or_else(|| keep.unwrap_or(Path::new(".")), |t| t.path());
        std::fs::create_dir_all(folder).map_err(|e| FileError::write(folder, e))?;
        let folder = std::path::absolute(folder).map_err(|e| FileError::read(folder, e))?;
        let mut before = VecDeque::new();
        if folder.join(DOCUMENT).exists() {
            let (theirs, captures) = load(&folder)?;
            if theirs != hello {
                let reason =
                    reason!("another-bench", "holds pictures of another bench. Give another folder to keep these in");
                return Err(CalibrateError::captures(&folder.join(DOCUMENT), reason));
            }
            before = captures.into();
        }
        let (taken, waited, left_out) = (Vec::new(), Duration::ZERO, Vec::new());
        let link = Some(link);
        let (exposure_ms, shows) = (None, None);
        Ok(Self { link, folder, temporary, hello, taken, before, color, most, exposure_ms, waited, left_out, shows })
    }

    /// Adds new pictures to the existing ones. Returns the earlier pictures of the color, which are not
    /// requested again.
    pub(super) fn adds(&mut self) -> Vec<Shot> {
        self.taken.extend(self.before.drain(..));
        let of_color =
            self.taken.iter().filter(|c| c.request.color.as_ref().is_none_or(|c| *c == self.color.0.to_string()));
        of_color.filter_map(|c| c.shot(&self.folder)?.ok()).collect()
    }

    pub(super) fn next(&self) -> usize {
        self.taken.len()
    }

    /// Drops the answers of the pictures from this number on, because they do not show the requested pattern.
    pub(super) fn leave_out_from(&mut self, number: usize) -> Result<(), CalibrateError> {
        self.taken.iter_mut().skip(number).for_each(|capture| capture.answer = None);
        self.write()
    }

    /// Number of pictures that were answered.
    pub(super) fn count(&self) -> usize {
        self.taken.iter().filter(|c| c.answer.is_some()).count()
    }

    /// Takes the first pictures of a calibration, of the dots and, if the camera can, of darkness. `iris_mm` is the
    /// place of an iris that does not move.
    pub(super) fn take_first(
        &mut self,
        display: &Display,
        dots: &Pattern,
        iris_mm: Option<[f64; 3]>,
    ) -> Result<Vec<Shot>, CalibrateError> {
        let optics = display.optics(self.color.0)?;
        let place = self.hello.iris.is_some().then(|| pattern::dots_iris(&optics));
        let Some(shot) = self.take(&Ask { show: Some(("dots", dots)), iris_mm: place, focus_mm: 0.0 })? else {
            let text = self.left_out.join("; ");
            return Err(CalibrateError::Refused { what: "take the picture of the dots".into(), text });
        };
        if shot.iris_mm.or(iris_mm).is_none() {
            let reason = reason!(
                "no-iris",
                "its iris does not move, and its place is unknown. Answer iris_mm, or give `iris` X,Y,DIAMETER in mm"
            );
            return Err(CalibrateError::bench(display, reason));
        }
        let dark = if self.hello.camera.dark { self.take(&Ask::default())? } else { None };
        Ok([shot].into_iter().chain(dark).collect())
    }

    /// Takes a picture. Returns none if the bench could not, or if the limit of pictures is reached.
    pub(super) fn take(&mut self, ask: &Ask) -> Result<Option<Shot>, CalibrateError> {
        for _ in 0..SHORTER {
            if self.count() >= self.most {
                return Ok(None);
            }
            let Some((shot, saturated)) = self.take_once(ask)? else { return Ok(None) };
            if saturated <= SATURATED || ask.show.is_none() {
                return Ok(Some(shot));
            }
            self.exposure_ms = Some(shot.exposure_ms / 2.0);
        }
        self.left_out.push(format!("a picture that stays saturated at {:.3} ms", self.exposure_ms.unwrap_or(0.0)));
        Ok(None)
    }

    fn take_once(&mut self, ask: &Ask) -> Result<Option<(Shot, f64)>, CalibrateError> {
        let number = format!("{:03}", self.taken.len());
        let kind = if self.hello.slm.takes.iter().any(|t| t == "levels") { "levels" } else { "phases" };
        let dark = ask.show.is_none();
        let exposure_ms = self.exposure_ms.or_else(|| match self.hello.camera.auto_exposure {
            true => None,
            false => self.hello.camera.exposure_ms.map(|[least, most]| (least * most).sqrt()).or(Some(10.0)),
        });
        let kind = if self.shows.is_some() { "phases" } else { kind };
        let show = ask.show.map(|(name, _)| Show { file: format!("{name}.npy"), kind: kind.into() });
        let (show, shown) = if self.shows.is_some() { (None, show) } else { (show, None) };
        let request = Request {
            id: self.taken.len() as u64,
            r#do: "capture".into(),
            show,
            color: (!dark).then(|| self.color.0.to_string()),
            wavelength_nm: (!dark).then_some(self.color.1),
            iris_mm: ask.iris_mm,
            focus_mm: self.hello.focus_mm.is_some().then_some(ask.focus_mm),
            exposure_ms: if dark { Some(exposure_ms.unwrap_or(10.0)) } else { exposure_ms },
            average: AVERAGE,
            out: number,
        };
        if let Some((name, pattern)) = ask.show {
            pattern.write(&self.folder.join(format!("{name}.npy")), kind == "levels")?;
        }
        let camera = self.hello.camera.resolution;
        if let Some(before) = self.before.pop_front() {
            let same_show = before.request.show == request.show && before.shown == shown;
            let answer = before.answer.as_ref().and_then(|a| Answer::read(a).ok());
            if let (true, true, Some(answer)) = (same_show, before.request.is_alike(&request), answer) {
                let shot = shot_of(&self.folder, before.show(), &request, &answer);
                if let Ok(picture) = shot.picture(camera) {
                    self.taken.push(Capture { request, ..before });
                    let saturated = answer.saturated.unwrap_or_else(|| picture.saturated());
                    return Ok(Some((shot, saturated)));
                }
            }
            // The request differs from here on, so the rest of the earlier run belongs to another calibration.
            self.before.clear();
        }
        self.ask(ask, request, shown)
    }

    fn ask(&mut self, ask: &Ask, request: Request, shown: Option<Show>) -> Result<Option<(Shot, f64)>, CalibrateError> {
        let Some(link) = &mut self.link else { return Ok(None) };
        if let (Some(shows), Some((_, pattern))) = (&mut self.shows, ask.show) {
            shows.show(self.color.0, &pattern.drive).map_err(CalibrateError::Shows)?;
        }
        let frames = ask.show.map_or(1, |(_, pattern)| pattern.frames);
        let seconds = request.exposure_ms.unwrap_or(1000.0) * 1e-3 * (3 * AVERAGE * frames) as f64;
        let (folder, camera) = (self.folder.clone(), self.hello.camera.resolution);
        let absolute = |name: &str| folder.join(name).display().to_string();
        let mut asked = request.clone();
        asked.out = absolute(&request.out);
        if let Some(show) = &mut asked.show {
            show.file = absolute(&show.file);
        }
        let mut question =
            serde_json::to_value(&asked).map_err(|e| CalibrateError::Pictures(Reason::new("not-json", e)))?;
        question.as_object_mut().map(|o| o.remove("id"));
        let begun = Instant::now();
        let answered = link.ask(&question, Duration::from_secs_f64(30.0 + seconds), |value| {
            let answer = Answer::read(value)?;
            let shot = shot_of(&folder, shown.as_ref().or(request.show.as_ref()), &request, &answer);
            let picture = picture::load(&shot.file, camera, shot.full_scale)?;
            Ok((shot, answer.saturated.unwrap_or_else(|| picture.saturated()), answer))
        });
        self.waited += begun.elapsed();
        let (kept, result) = match answered? {
            Ok((shot, saturated, mut answer)) => {
                if let Ok(inside) = Path::new(&answer.file).strip_prefix(&self.folder) {
                    answer.file = inside.display().to_string();
                }
                (serde_json::to_value(&answer).ok(), Some((shot, saturated)))
            }
            Err(text) => {
                self.left_out.push(text.to_string());
                (None, None)
            }
        };
        self.taken.push(Capture { request, answer: kept, shown });
        self.write()?;
        Ok(result)
    }

    /// Writes the folder's document with the captures up to now.
    fn write(&self) -> Result<(), CalibrateError> {
        if self.temporary.is_some() {
            return Ok(());
        }
        let document =
            Document { protocol: super::message::PROTOCOL, hello: self.hello.clone(), captures: self.taken.clone() };
        let file = self.folder.join(DOCUMENT);
        let text = serde_json::to_string_pretty(&document)
            .map_err(|e| CalibrateError::Pictures(Reason::new("not-json", e)))?;
        Ok(write_file(&file, |out| out.write_all(text.as_bytes()))?)
    }

    pub(super) fn into_folder(self) -> Option<tempfile::TempDir> {
        self.temporary
    }

    /// Sends bye to the command.
    pub(super) fn end(&mut self) {
        if let Some(link) = self.link.take() {
            link.bye();
        }
    }
}

/// The picture of a request and its answer. Files are in `folder`.
fn shot_of(folder: &Path, show: Option<&Show>, request: &Request, answer: &Answer) -> Shot {
    Shot {
        show: show.map(|s| (folder.join(&s.file), s.kind.clone())),
        file: folder.join(&answer.file),
        full_scale: answer.full_scale,
        exposure_ms: answer.exposure_ms.or(request.exposure_ms).unwrap_or(1.0),
        iris_mm: answer.iris_mm.or(request.iris_mm),
        focus_mm: answer.focus_mm.or(request.focus_mm).unwrap_or(0.0),
    }
}

/// Reads the requested phases of a pattern that was shown.
pub(super) fn shown(file: &Path, kind: &str, slm: [usize; 2], two_pi_level: f64) -> Result<Pattern, CalibrateError> {
    let npy = files::read_npy(file)?;
    let wrong = |reason: Reason| CalibrateError::captures(file, reason);
    let [frames, height, width] = npy.shape[..] else {
        return Err(wrong(reason!(
            "pattern-axes",
            "has {} axes, but patterns are (sub-frame, row, column)",
            npy.shape.len()
        )));
    };
    if [height, width] != slm || frames == 0 {
        return Err(wrong(reason!(
            "pattern-size",
            "has {frames} patterns of {height}x{width} pixels, but the SLM has {}x{}",
            slm[0],
            slm[1]
        )));
    }
    let turn = if kind == "levels" { std::f64::consts::TAU / two_pi_level } else { 1.0 };
    let drive = npy.values.iter().map(|v| (f64::from(*v) * turn).rem_euclid(std::f64::consts::TAU) as f32).collect();
    Ok(Pattern { frames, height, width, two_pi_level, drive })
}
