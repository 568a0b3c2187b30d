//! Defines the methods and the existing holograms that a comparison measures.

use super::MethodAbout;
use eyebox::low_level::error::Reason;
use eyebox::low_level::hologram::Hologram;
use eyebox::low_level::optics::{Color, Display, Prescription};
use eyebox::low_level::quality::QualityError;
use eyebox::low_level::reason;
use eyebox::low_level::solve::Method;
use std::path::PathBuf;

/// One column of the comparison.
pub struct Candidate {
    /// The method's name, or the name that an existing hologram was given.
    pub name: String,
    /// The source of its holograms.
    pub source: Source,
}

/// The source of a candidate's holograms.
pub enum Source {
    /// The comparison solves the holograms with this method.
    Solved(Method),
    /// The holograms exist already.
    Given(Vec<ExistingHologram>),
}

/// A hologram that was solved before the comparison.
pub struct ExistingHologram {
    /// The name in the report.
    pub name: String,
    /// The file from which the hologram was read.
    pub file: PathBuf,
    /// The hologram with its phases and metadata.
    pub hologram: Hologram,
    /// The index of the scene that it shows.
    pub scene: usize,
}

impl Candidate {
    /// Returns the numbers of sub-frames of its holograms for a scene. Methods solve with each of `frames`.
    pub(super) fn frames(&self, scene: usize, frames: &[usize]) -> Vec<usize> {
        match &self.source {
            Source::Solved(_) => frames.to_vec(),
            Source::Given(all) => all.iter().filter(|g| g.scene == scene).map(|g| g.hologram.frames).collect(),
        }
    }

    /// Returns the existing hologram of a scene with this number of sub-frames.
    pub(super) fn given(&self, scene: usize, frames: usize) -> Option<&Hologram> {
        let Source::Given(all) = &self.source else { return None };
        all.iter().map(|g| (g.scene, &g.hologram)).find(|(s, h)| *s == scene && h.frames == frames).map(|(_, h)| h)
    }

    pub(super) fn about(&self) -> MethodAbout {
        let name = self.name.clone();
        match &self.source {
            Source::Solved(m) => {
                let [title, about, citation] = [m.title(), m.about(), m.citation()].map(String::from);
                MethodAbout { name, title, about, citation }
            }
            Source::Given(all) => {
                let files: Vec<String> = all.iter().map(|g| g.file.display().to_string()).collect();
                let about = "Holograms that existed before.".into();
                MethodAbout { title: name.clone(), name, about, citation: files.join(", ") }
            }
        }
    }
}

impl ExistingHologram {
    /// Registers a hologram that was read from `file` under this name.
    ///
    /// If there are several scenes, the hologram must name the one that it shows. If there is one, it must not show
    /// another, except with `other_scene`.
    ///
    /// # Errors
    /// Returns [`QualityError::Input`] if the hologram cannot be compared.
    pub fn new(
        name: &str,
        file: PathBuf,
        hologram: Hologram,
        scenes: &[String],
        other_scene: bool,
    ) -> Result<Self, QualityError> {
        let wrong = |reason: Reason| QualityError::Input { what: file.display().to_string(), reason };
        if Method::by_name(name).is_some() {
            return Err(wrong(reason!(
                "name-of-a-method",
                "'{name}' is the name of a method. Give the hologram another name."
            )));
        }
        if hologram.colors.iter().any(|c| c.color.is_none()) || hologram.display_wavelengths.is_empty() {
            return Err(wrong(reason!("no-display", "its colors have no names, or its display is unknown")));
        }
        let scene = match scenes {
            [one] => {
                let checked = if other_scene { Ok(()) } else { hologram.check_scene(one) };
                checked.map(|()| 0).map_err(|e| wrong(Reason::of(&e)))?
            }
            _ if hologram.scene.is_empty() => {
                return Err(wrong(reason!("no-scene", "it does not name the scene that it shows")));
            }
            _ => scenes.iter().position(|s| hologram.check_scene(s).is_ok()).ok_or_else(|| {
                wrong(reason!("other-scene", "it shows '{}', which is not one of the scenes", hologram.scene))
            })?,
        };
        Ok(Self { name: name.into(), file, hologram, scene })
    }

    /// Refuses a hologram that cannot be compared with holograms of this display in these colors.
    ///
    /// # Errors
    /// Returns [`QualityError::Input`] if size, colors, geometry, prescription, pitch, focal length or wavelengths
    /// differ.
    pub fn check(&self, display: &Display, colors: &[Color]) -> Result<(), QualityError> {
        let h = &self.hologram;
        let wrong = |reason: Reason| Err(QualityError::Input { what: self.file.display().to_string(), reason });
        if (h.height, h.width) != (display.height, display.width) {
            let ([a, b], [c, d]) = ([h.height, h.width], [display.height, display.width]);
            return wrong(reason!("size", "{a} x {b} pixels, but the display has {c} x {d}"));
        }
        if self.hologram.named_colors() != colors || h.colors.len() != colors.len() {
            let list = |c: &[Color]| c.iter().map(Color::to_string).collect::<Vec<_>>().join(", ");
            let (has, wanted) = (list(&self.hologram.named_colors()), list(colors));
            return wrong(reason!("colors", "its colors are {has}, not {wanted}. Choose the colors with `color`."));
        }
        if h.geometry != display.geometry {
            let (made, is) = (h.geometry.name(), display.geometry.name());
            return wrong(reason!("geometry", "made for a {made} display, but '{}' is {is}", display.name));
        }
        if h.metadata.prescription != display.prescription {
            let in_words = |eye: &Option<Prescription>| eye.as_ref().map_or("none".into(), Prescription::to_string);
            let (made, looks) = (in_words(&h.metadata.prescription), in_words(&display.prescription));
            return wrong(reason!(
                "prescription",
                "its prescription is {made}, but the viewing eye has {looks}. Change the `prescription`."
            ));
        }
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-6 * b.abs();
        let same_waves = h.display_wavelengths.len() == display.wavelengths.len()
            && h.display_wavelengths.iter().zip(&display.wavelengths).all(|(a, b)| near(a.wavelength, b.wavelength));
        if !same_waves || !near(h.pitch, display.pitch) || !near(h.focal_length, display.focal_length) {
            return wrong(reason!(
                "display",
                "made for the display '{}', but '{}' has another pitch, focal length or wavelengths",
                h.display,
                display.name
            ));
        }
        Ok(())
    }
}

/// Lists the methods first and then the existing holograms, grouped by name.
///
/// # Errors
/// Returns [`QualityError::Input`] if two holograms have one name and one scene.
pub fn candidates(methods: &[Method], given: Vec<ExistingHologram>) -> Result<Vec<Candidate>, QualityError> {
    let solved = |m: &Method| Candidate { name: m.name().into(), source: Source::Solved(*m) };
    let mut all: Vec<Candidate> = methods.iter().map(solved).collect();
    for one in given {
        match all.iter_mut().find(|s| s.name == one.name).map(|s| &mut s.source) {
            Some(Source::Given(same)) if same.iter().any(|g| g.scene == one.scene) => {
                let reason = reason!("twice", "'{}' is given twice for one scene", one.name);
                return Err(QualityError::Input { what: one.file.display().to_string(), reason });
            }
            Some(Source::Given(same)) => same.push(one),
            _ => all.push(Candidate { name: one.name.clone(), source: Source::Given(vec![one]) }),
        }
    }
    Ok(all)
}
