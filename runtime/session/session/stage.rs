//! Builds a display, scenes and colors for tests of sessions and studies.

use crate::encode::Encoder;
use crate::engine::cpu::CpuEngine;
use crate::engine::{Engine, EngineError};
use crate::optics::{Color, Display, Laser, Padding};
use crate::scene::{self, LightField, Pyramid, Request};
use crate::session::content::shifted::shifted_problem;
use crate::session::refinement::field::LiveColor;
use crate::solve::{Flow, Problem, Settings, StartTable, random_phases, solve};
use std::sync::Arc;

/// The colors of a joint hologram.
pub const ALL: [Color; 3] = [Color::Red, Color::Green, Color::Blue];
/// The rows and columns of its display.
pub const SIZE: [usize; 2] = [48, 64];

/// The exposure of the scenes.
pub const EXPOSURE: f64 = 0.35;

/// Returns a green picture of the size of a display that is the same from the whole eyebox.
pub fn one_view(display: &Display, view: Vec<f32>) -> LightField {
    LightField {
        name: String::new(),
        grid: [1, 1],
        height: display.height,
        width: display.width,
        colors: vec![Color::Green],
        planes: vec![vec![view]],
        view_pitch: Some(display.eyebox_min()),
        disparity: None,
        depth: None,
        made: None,
    }
}

/// A square display of one color, and scenes of a fruit at different places before it.
pub struct Scripted {
    /// The display of the scenes.
    pub display: Display,
    /// The scene for each place of the fruit.
    pub scenes: Vec<LiveColor>,
}

impl Scripted {
    /// Creates scenes with the packing of this preset.
    pub fn new(preset: &str, side: usize, scenes: usize) -> Self {
        Self::before(Display { height: side, width: side, ..Display::preset(preset).unwrap() }, scenes)
    }

    /// Creates the scenes before a display.
    pub fn before(display: Display, scenes: usize) -> Self {
        let scene = |i: usize| {
            let request = Request { views: 5, ..Request::new(&display, &[Color::Green]) };
            let name = format!("builtin:still-life?shift={}", i as f64 * 0.05);
            let field = scene::load(&name, &request).unwrap();
            let problem = Problem::new(&field, Color::Green, &display, Padding::default()).unwrap();
            LiveColor { problem, phases: Vec::new(), exposure: EXPOSURE, laser: None }
        };
        let scenes = (0..scenes).map(scene).collect();
        Self { display, scenes }
    }

    /// Returns the scene of content frame `number`. The scenes are shown in order and then in reverse.
    pub fn scene(&self, number: u64) -> &LiveColor {
        let last = self.scenes.len() - 1;
        let at = number as usize % (2 * last).max(1);
        &self.scenes[if at > last { 2 * last - at } else { at }]
    }

    /// Returns random phases of eight sub-frames.
    pub fn begun(&self) -> Vec<LiveColor> {
        let pixels = self.display.height * self.display.width;
        vec![LiveColor { phases: random_phases(8 * pixels, 1), ..self.scenes[0].clone() }]
    }

    /// Creates an encoder of eight sub-frames.
    pub fn encoder(&self) -> Encoder {
        Encoder::new(&self.display, &[Color::Green], 8).unwrap()
    }

    /// Fits a table of the display in fewer steps than usual.
    pub fn tables(&self) -> Vec<Option<Arc<StartTable>>> {
        let color = &self.begun()[0];
        vec![Some(Arc::new(StartTable::quick(&color.problem, color.frames())))]
    }
}

/// Opens the CPU engine, as an opener of a session does. It never fails.
pub fn cpu() -> Result<Box<dyn Engine>, EngineError> {
    Ok(Box::new(CpuEngine::new()))
}

/// Returns a color whose content is shifted to the right (pixels).
pub fn shifted_color(color: &LiveColor, shift: usize) -> LiveColor {
    LiveColor { problem: shifted_problem(&color.problem, shift, false), ..color.clone() }
}

/// Returns the display of colors that share their sub-frames.
pub fn joint_display() -> Display {
    Display { height: SIZE[0], width: SIZE[1], ..Display::preset("grey8").unwrap() }
}

/// Returns random drives before three lasers, on a display.
pub fn joint_colors(display: &Display) -> Vec<LiveColor> {
    let field = scene::load("builtin:still-life", &Request { views: 3, ..Request::new(display, &ALL) }).unwrap();
    let powers = [vec![0.4, 1.9, 0.7], vec![1.0, 0.2, 1.8], vec![1.5, 1.5, 0.0]];
    let drives = random_phases(3 * SIZE[0] * SIZE[1], 4);
    let one = |((color, slope), powers): ((Color, f64), Vec<f64>)| {
        let problem = Problem::new(&field, color, display, Padding::default()).unwrap();
        let laser = Laser { slope, powers };
        LiveColor { problem, phases: laser.phases(&drives), exposure: 0.35, laser: Some(laser) }
    };
    ALL.into_iter().zip(display.slopes(&ALL)).zip(powers).map(one).collect()
}

/// Returns the negative of the picture of these colors.
pub fn inverted(colors: &[LiveColor]) -> Vec<LiveColor> {
    let one = |color: &LiveColor| {
        let (pyramid, level) = (&color.problem.pyramid, &color.problem.pyramid.levels[0]);
        let value = |v: &u16| 0.3 * (1.0 - f32::from(*v) / 65_535.0 * pyramid.scale).max(0.0);
        let views = level.views.chunks_exact(level.height * level.width);
        let views: Vec<Vec<f32>> = views.map(|view| view.iter().map(value).collect()).collect();
        let pyramid = Arc::new(Pyramid::new(&views, level.height, level.width));
        let problem = Problem { pyramid, ..color.problem.clone() };
        LiveColor { problem, phases: Vec::new(), ..color.clone() }
    };
    colors.iter().map(one).collect()
}

/// Fits the table of the drive that these colors share, in fewer steps than usual.
pub fn drive_table(colors: &[LiveColor]) -> Arc<StartTable> {
    let problems: Vec<&Problem> = colors.iter().map(|color| &color.problem).collect();
    let lasers: Vec<Laser> = colors.iter().filter_map(|color| color.laser.clone()).collect();
    Arc::new(StartTable::quick_shared(&problems, &lasers))
}

/// Returns a color of a still life that was solved for the whole eyebox.
pub fn part() -> LiveColor {
    let display = Display { height: 96, width: 112, ..Display::preset("small").unwrap() };
    let field = scene::load("builtin:still-life", &Request::new(&display, &[Color::Green])).unwrap();
    let problem = Problem::new(&field, Color::Green, &display, Padding::default()).unwrap();
    let settings = Settings { steps: 24, diameter: [2e-3, 18e-3], depth: [-5e-4, 5e-4], ..Settings::default() };
    let solution = solve(&problem, &settings, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap();
    LiveColor { problem, phases: solution.phases, exposure: solution.exposure, laser: None }
}

/// Creates an encoder for the display of [`part`], with eight sub-frames packed as bits of one byte.
pub fn encoder() -> Encoder {
    encoder_of("planes8")
}

/// Creates the same encoder with the packing of this preset.
pub fn encoder_of(preset: &str) -> Encoder {
    let display = Display { height: 96, width: 112, ..Display::preset(preset).unwrap() };
    Encoder::new(&display, &[Color::Green], 8).unwrap()
}
