//! What is compared: methods to solve with, and holograms that exist.

use super::Evaluate;
use crate::Failure;
use eyebox::hologram::Hologram;
use eyebox::optics::{Color, Display};
use eyebox::solve::Method;
use std::path::PathBuf;

/// The methods that are compared where nothing else is asked for.
pub const DEFAULT: [&str; 5] = ["slfh", "lf2fs", "stft", "smooth", "dpac"];

/// One column of the comparison.
pub struct Subject {
    /// The method's name, or the one that was given.
    pub name: String,
    /// Where its holograms come from.
    pub source: Source,
}

/// Where holograms come from.
pub enum Source {
    /// They are solved.
    Solved(Method),
    /// They are there.
    Given(Vec<Given>),
}

/// A hologram that is there.
pub struct Given {
    /// Its name in the report.
    pub name: String,
    /// Where it was read from.
    pub file: PathBuf,
    /// It.
    pub hologram: Hologram,
    /// Which of the scenes it shows.
    pub scene: usize,
}

impl Given {
    /// Refuses what cannot be compared with the rest.
    pub fn check(&self, display: &Display, colors: &[Color]) -> Result<(), Failure> {
        let (file, h) = (self.file.display(), &self.hologram);
        if (h.height, h.width) != (display.height, display.width) {
            return Err(Failure::Asked(format!(
                "{file}: {} x {} pixels, but what it is compared with has {} x {}",
                h.height, h.width, display.height, display.width
            )));
        }
        if self.hologram.named_colors() != colors || h.colors.len() != colors.len() {
            let list = |c: &[Color]| c.iter().map(Color::to_string).collect::<Vec<_>>().join(", ");
            let (has, wanted) = (list(&self.hologram.named_colors()), list(colors));
            return Err(Failure::Asked(format!("{file}: its colours are {has}, not {wanted}: choose with --color")));
        }
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-6 * b.abs();
        let same_waves = h.display_wavelengths.len() == display.wavelengths.len()
            && h.display_wavelengths.iter().zip(&display.wavelengths).all(|(a, b)| near(a.wavelength, b.wavelength));
        if h.geometry != display.geometry {
            let (made, is) = (h.geometry.name(), display.geometry.name());
            return Err(Failure::Asked(format!("{file}: made for a {made} display, and '{}' is {is}", display.name)));
        }
        if !same_waves || !near(h.pitch, display.pitch) || !near(h.focal_length, display.focal_length) {
            return Err(Failure::Asked(format!(
                "{file}: made for the display '{}', whose pitch, focal length or wavelengths are not those of '{}'",
                h.display, display.name
            )));
        }
        Ok(())
    }
}

/// The methods of these names, each once.
pub fn methods(names: &[String]) -> Result<Vec<Method>, Failure> {
    let mut methods = Vec::new();
    for name in names {
        let known = || Method::ALL.map(Method::name).join(", ");
        let method = Method::by_name(name.trim())
            .ok_or_else(|| Failure::Asked(format!("no method is called '{name}': there are {}", known())))?;
        if !methods.contains(&method) {
            methods.push(method);
        }
    }
    Ok(methods)
}

/// Reads the holograms that were given. One that says which of several scenes it shows belongs there.
pub fn given(named: &[(String, PathBuf)], args: &Evaluate) -> Result<Vec<Given>, Failure> {
    let mut all: Vec<Given> = Vec::new();
    for (name, file) in named {
        let wrong = |reason: String| Failure::Asked(format!("{}: {reason}", file.display()));
        if Method::by_name(name).is_some() {
            return Err(wrong(format!("'{name}' is the name of a method: give the hologram another")));
        }
        let hologram = Hologram::load(file)?;
        if hologram.colors.iter().any(|c| c.color.is_none()) || hologram.display_wavelengths.is_empty() {
            return Err(wrong("its colours are not named, or its display is not known".into()));
        }
        let shows = |source: &String| {
            let last = std::path::Path::new(source).canonicalize().ok();
            let last = last.as_ref().and_then(|p| p.file_name()).map(|n| n.to_string_lossy().into_owned());
            *source == hologram.scene || last.is_some_and(|l| l == hologram.scene)
        };
        let scene =
            match args.scenes.len() {
                1 => 0,
                _ => args.scenes.iter().position(shows).ok_or_else(|| {
                    wrong(format!("it shows '{}', which is none of the scenes given", hologram.scene))
                })?,
            };
        if all.iter().any(|g| g.name == *name && g.scene == scene) {
            return Err(wrong(format!("'{name}' is given twice for one scene")));
        }
        all.push(Given { name: name.clone(), file: file.clone(), hologram, scene });
    }
    Ok(all)
}

/// Methods first, then what was given, by name.
pub fn subjects(methods: &[Method], given: Vec<Given>) -> Vec<Subject> {
    let mut subjects: Vec<Subject> =
        methods.iter().map(|m| Subject { name: m.name().into(), source: Source::Solved(*m) }).collect();
    for one in given {
        let same = subjects.iter_mut().find(|s| s.name == one.name);
        match same.map(|s| &mut s.source) {
            Some(Source::Given(all)) => all.push(one),
            _ => subjects.push(Subject { name: one.name.clone(), source: Source::Given(vec![one]) }),
        }
    }
    subjects
}
