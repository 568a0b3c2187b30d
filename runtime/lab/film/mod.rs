//! Writes films of the images that an eye sees while it moves, focuses and blinks.
//!
//! An [`EyePath`] gives the state of the eye at each time. [`film`] renders the [`Content`] of that time for this eye,
//! next to the target image. It writes a Y4M video or a folder of numbered PNGs. The result does not depend on the
//! machine's time, so the same path gives the same pictures. If neither the eye nor the content changes, a frame
//! repeats the pictures of the frame before.

mod error;
mod path;
mod picture;
mod y4m;

pub use error::FilmError;
pub use path::{EyePath, Key, Moment};

use eyebox::low_level::engine::Engine;
use eyebox::low_level::evaluate::Plane;
use eyebox::low_level::files::{FileError, FolderDraft, encode_png8, write_file};
use eyebox::low_level::hologram::PhaseSource;
use eyebox::low_level::optics::{Color, Pupil};
use eyebox::low_level::reason;
use eyebox::low_level::reconstruction::{Sampling, SceneSource};
use eyebox::low_level::solve::Flow;
use picture::Canvas;
use std::fs;
use std::io;
use std::path::Path;

/// The settings of a film.
#[derive(Debug, Clone, Copy)]
pub struct FilmSettings {
    /// The image of the hologram, the target image of its scene, or both.
    pub content: FilmContent,
    /// The number of pixels along each axis that become one pixel, as their mean in linear light.
    pub binning: usize,
}

impl Default for FilmSettings {
    fn default() -> Self {
        Self { content: FilmContent::Both, binning: 1 }
    }
}

/// The content of a film at one time.
pub struct Content {
    /// The phases of the hologram.
    pub source: PhaseSource<'static>,
    /// The scene of the hologram. `None` for a film of the hologram alone.
    pub scene: Option<SceneSource>,
    /// The intensity scale of each color.
    pub exposures: Vec<f64>,
}

/// The content of the frames of a film.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum FilmContent {
    /// The image of the hologram.
    Image,
    /// The target image of the scene.
    Target,
    /// Both, the image on the left.
    #[default]
    Both,
}

/// The result of a film.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Film {
    /// The number of frames.
    pub frames: usize,
    /// Rows and columns of a frame, in pixels.
    pub size: [usize; 2],
    /// The number of rendered frames. The others repeat the frame before them.
    pub looked: usize,
}

/// Returns the content at a time in seconds if it differs from the content before. It must return content at time 0.
pub type Load<'a, E> = dyn FnMut(f64) -> Result<Option<Content>, E> + 'a;

/// Films the images along `path`, in order, into `out`.
///
/// The output is a file NAME.y4m, or a folder of PNGs named `frame-00000.png` and so on. It appears only once it is
/// complete. `observe` receives the index of the frame and the number of frames. [`Flow::Stop`] ends the film without
/// output (`Ok(None)`).
///
/// # Errors
/// Returns [`FilmError`] if the film cannot be made, and the errors of `load`.
pub fn film<E: From<FilmError>>(
    path: &EyePath,
    settings: &FilmSettings,
    load: &mut Load<E>,
    out: &Path,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(usize, usize) -> Flow,
) -> Result<Option<Film>, E> {
    if !(1..=64).contains(&settings.binning) {
        let reason = reason!("binning", "binning is {}, but must be 1 to 64 pixels", settings.binning);
        return Err(FilmError::Setting(reason).into());
    }
    let mut shooting = Shooting { path, settings, content: None, last: None, looked: 0, load, observe };
    let video = out.extension().is_some_and(|e| e.eq_ignore_ascii_case("y4m"));
    if !video {
        let draft = FolderDraft::new(out, holds_only_frames).map_err(FilmError::File)?;
        let made = shooting.all(engine, &mut |index, canvas| {
            let [rows, columns] = canvas.size;
            let name = frame_name(index);
            draft
                .write(&name, |out| encode_png8(out, rows, columns, 3, &canvas.rgb))
                .map_err(|e| FilmError::File(e).into())
        })?;
        if made.is_some() {
            draft.put().map_err(FilmError::File)?;
        }
        return Ok(made);
    }
    // The file writer only passes on errors of the system. Other errors that end a film are kept in `ended`.
    let mut ended: Result<Option<Film>, E> = Ok(None);
    let written = write_file(out, |file| {
        ended = shooting.all(engine, &mut |index, canvas| {
            let head = if index == 0 { y4m::head(file, canvas.size, path.rate()) } else { Ok(()) };
            let written = head.and_then(|()| y4m::frame(file, canvas));
            written.map_err(|e| FilmError::File(FileError::write(out, e)).into())
        });
        if matches!(ended, Ok(Some(_))) { Ok(()) } else { Err(io::Error::other("the film ended early")) }
    });
    match ended {
        Ok(Some(made)) => {
            written.map_err(FilmError::File)?;
            Ok(Some(made))
        }
        other => other,
    }
}

fn frame_name(index: usize) -> String {
    format!("frame-{index:05}.png")
}

/// Returns true if a folder holds only frames of a film.
fn holds_only_frames(folder: &Path) -> bool {
    let ours = |name: &str| {
        let number = name.strip_prefix("frame-").and_then(|rest| rest.strip_suffix(".png"));
        number.is_some_and(|n| n.len() >= 5 && n.bytes().all(|b| b.is_ascii_digit()))
    };
    fs::read_dir(folder).is_ok_and(|mut all| all.all(|e| e.is_ok_and(|e| e.file_name().to_str().is_some_and(ours))))
}

/// A film in progress.
struct Shooting<'a, 'b, E> {
    path: &'a EyePath,
    settings: &'a FilmSettings,
    content: Option<Content>,
    /// The pupil of the last pictures, and these pictures as reconstruction and target image.
    last: Option<(Pupil, [Option<Vec<Plane>>; 2])>,
    looked: usize,
    load: &'a mut Load<'b, E>,
    observe: &'a mut dyn FnMut(usize, usize) -> Flow,
}

impl<E: From<FilmError>> Shooting<'_, '_, E> {
    fn all(
        &mut self,
        engine: &mut dyn Engine,
        take: &mut dyn FnMut(usize, &Canvas) -> Result<(), E>,
    ) -> Result<Option<Film>, E> {
        let frames = self.path.frames();
        let mut size = None;
        for index in 0..frames {
            if (self.observe)(index, frames) == Flow::Stop {
                return Ok(None);
            }
            let time = self.path.time(index);
            if let Some(content) = (self.load)(time)? {
                (self.content, self.last) = (Some(content), None);
            }
            let content = self.content.as_ref();
            let content = content.ok_or_else(|| FilmError::Setting(reason!("nothing", "no content at time 0")))?;
            let moment = self.path.at(time, content.source.about().focal_length);
            if self.last.as_ref().is_none_or(|(pupil, _)| *pupil != moment.pupil) {
                let pictures = look(content, &moment.pupil, self.settings, engine)?;
                self.last = Some((moment.pupil, pictures));
                self.looked += 1;
            }
            let Some((_, [seen, wanted])) = &self.last else { continue };
            let names: Vec<Option<Color>> = content.source.about().colors.iter().map(|c| c.color).collect();
            let pictures: Vec<&[Plane]> = seen.iter().chain(wanted).map(|planes| &planes[..]).collect();
            let canvas = Canvas::of(&pictures, &names, moment.lid as f32);
            if size.is_some_and(|before| before != canvas.size) {
                let reason = reason!("sizes", "the pictures of the holograms differ in size, but a film has one");
                return Err(FilmError::Setting(reason).into());
            }
            size = Some(canvas.size);
            take(index, &canvas)?;
        }
        Ok(size.map(|size| Film { frames, size, looked: self.looked }))
    }
}

/// Returns the image of the content at its exposures and the target image, if they are requested.
fn look(
    content: &Content,
    pupil: &Pupil,
    settings: &FilmSettings,
    engine: &mut dyn Engine,
) -> Result<[Option<Vec<Plane>>; 2], FilmError> {
    let about = content.source.about();
    let mut seen = None;
    if settings.content != FilmContent::Target || content.scene.is_none() {
        let mut planes = about.as_seen(content.source.look(None, pupil, engine)?);
        for (plane, exposure) in planes.iter_mut().zip(&content.exposures) {
            plane.values.iter_mut().for_each(|v| *v *= *exposure as f32);
        }
        seen = Some(planes);
    }
    let wanted = match &content.scene {
        Some(scene) if settings.content != FilmContent::Image => {
            let mut planes = Vec::new();
            for color in 0..scene.colors() {
                planes.extend(scene.photographs(color, &[*pupil], Sampling::Picture, engine)?);
            }
            Some(planes)
        }
        _ => None,
    };
    let binned = |planes: Vec<Plane>| planes.iter().map(|p| picture::binned(p, settings.binning)).collect::<Vec<_>>();
    let of_one_size =
        |planes: &[Plane]| planes.windows(2).all(|p| (p[0].rows, p[0].columns) == (p[1].rows, p[1].columns));
    if [&seen, &wanted].into_iter().flatten().any(|planes| !of_one_size(planes)) {
        let reason =
            reason!("sizes-of-colors", "the colors have pictures of different sizes, as in tiles. Film one color.");
        return Err(FilmError::Setting(reason));
    }
    Ok([seen.map(binned), wanted.map(binned)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use eyebox::low_level::engine::cpu::CpuEngine;
    use eyebox::low_level::error::Reason;
    use eyebox::low_level::hologram::{ColorHologram, Hologram};
    use eyebox::low_level::optics::Display;
    use eyebox::low_level::scene::{self, Request};

    fn content(salt: usize) -> Content {
        let display = Display { height: 24, width: 24, ..Display::preset("small").unwrap() };
        let request = Request { views: 3, ..Request::new(&display, &[Color::Green]) };
        let field = scene::load("builtin:plane", &request).unwrap();
        let color = ColorHologram {
            color: Some(Color::Green),
            wavelength: 520e-9,
            exposure: 0.4,
            efficiency: 0.4,
            phases: (0..576).map(|i| (i * (37 + salt) % 100) as f32 * 0.06 - 3.0).collect(),
        };
        let hologram = Hologram { height: 24, width: 24, ..Hologram::on(&display, 1, vec![color]) };
        let scene = SceneSource::new(field, &display).unwrap();
        Content { source: hologram.into(), scene: Some(scene), exposures: vec![0.4] }
    }

    fn path(text: &str) -> EyePath {
        EyePath::from_json(text, "p.json").unwrap()
    }

    const STILL_AND_BLINK: &str =
        r#"{"rate_hz": 20, "keys": [{"t_s": 0, "diameter_mm": 6}, {"t_s": 1, "x_mm": 0}], "blinks_s": [0.3]}"#;

    #[test]
    fn a_film_is_the_same_again_and_looks_only_where_something_changed() {
        let here = tempfile::tempdir().unwrap();
        let mut engine = CpuEngine::new();
        let mut shoot = |name: &str, settings: &FilmSettings| {
            let mut load =
                |t: f64| -> Result<_, FilmError> { Ok((t == 0.0 || t == 0.5).then(|| content((t * 2.0) as usize))) };
            let out = here.path().join(name);
            let made = film(&path(STILL_AND_BLINK), settings, &mut load, &out, &mut engine, &mut |_, _| Flow::Continue);
            (made.unwrap().unwrap(), out)
        };
        let both = FilmSettings::default();
        let (made, first) = shoot("a.y4m", &both);
        // The film lasts a second and includes the last frame. It has two contents and one eye.
        assert_eq!((made.frames, made.looked, made.size[0]), (21, 2, 24));
        let (_, again) = shoot("b.y4m", &both);
        let bytes = std::fs::read(first).unwrap();
        assert_eq!(bytes, std::fs::read(again).unwrap());
        let line =
            format!("YUV4MPEG2 W{} H24 F20:1 Ip A1:1 C444 XCOLORRANGE=LIMITED XCOLORMATRIX=BT601\n", made.size[1]);
        assert!(bytes.starts_with(line.as_bytes()));
        let frame = 6 + 3 * made.size[0] * made.size[1];
        assert_eq!(bytes.len(), line.len() + 21 * frame);
        let of = |i: usize| &bytes[line.len() + i * frame..][..frame];
        // The lid is down at 0.42 s, and the picture changes after half a second.
        assert!(of(0) == of(5) && of(0) != of(8) && of(0) != of(20) && of(15) == of(20));
        let luma = |i: usize| of(i)[6..6 + 24 * 24].iter().map(|v| u32::from(*v)).sum::<u32>();
        assert!(luma(8) < luma(0) / 2);
        let (alone, folder) = shoot("pictures", &FilmSettings { content: FilmContent::Image, binning: 2 });
        assert_eq!(alone.size, [12, 12]);
        assert!((0..21).all(|i| folder.join(frame_name(i)).is_file()));
        // A film replaces only a film.
        shoot("pictures", &FilmSettings { content: FilmContent::Image, binning: 3 });
        std::fs::write(folder.join("mine.txt"), "").unwrap();
        let mut load = |_| -> Result<_, FilmError> { Ok(Some(content(0))) };
        let taken = film(&path(STILL_AND_BLINK), &both, &mut load, &folder, &mut engine, &mut |_, _| Flow::Continue);
        assert!(matches!(taken, Err(FilmError::File(FileError::Taken { .. }))), "{taken:?}");
    }

    #[test]
    fn a_film_that_is_stopped_or_cannot_be_made_leaves_nothing() {
        let here = tempfile::tempdir().unwrap();
        let mut engine = CpuEngine::new();
        for name in ["a.y4m", "a"] {
            let out = here.path().join(name);
            let mut load = |t: f64| -> Result<_, FilmError> { Ok((t == 0.0).then(|| content(0))) };
            let stop = &mut |i, _| if i == 3 { Flow::Stop } else { Flow::Continue };
            let settings = FilmSettings::default();
            let path = path(STILL_AND_BLINK);
            assert_eq!(film(&path, &settings, &mut load, &out, &mut engine, stop).unwrap(), None);
            let mut nothing =
                |_| -> Result<_, FilmError> { Err(FilmError::Setting(Reason::new("no-such-scene", "no such scene"))) };
            let failed = film(&path, &settings, &mut nothing, &out, &mut engine, &mut |_, _| Flow::Continue);
            assert!(matches!(failed, Err(FilmError::Setting(reason)) if reason.code() == "no-such-scene"));
            let none = FilmSettings { binning: 0, ..settings };
            assert!(film(&path, &none, &mut load, &out, &mut engine, &mut |_, _| Flow::Continue).is_err());
            assert_eq!(std::fs::read_dir(here.path()).unwrap().count(), 0);
        }
    }
}
