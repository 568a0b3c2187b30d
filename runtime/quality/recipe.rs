//! The settings that trade quality for time.

use super::Quality;
use crate::optics::{Display, Geometry, Padding, WindowFactor};
use crate::plan::Storage;
use crate::scene::LightField;
use crate::solve::{Diameters, Optimizer, Settings};
use serde::{Deserialize, Serialize};

/// Everything about a solve that trades quality for time, as plain data. What it does not say (depths, diameters, seed,
/// levels, sub-frames shown) belongs to the scene and the display.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Recipe {
    /// Steps.
    pub steps: usize,
    /// Pupils a step.
    pub pupils: usize,
    /// How phases are moved.
    pub optimizer: Optimizer,
    /// Distribution of the diameters drawn.
    pub diameters: Diameters,
    /// Window per pupil.
    pub window: WindowFactor,
    /// How often each solved sub-frame is shown: 2 solves half of them. What does not divide the number shown counts as
    /// the largest number that divides both.
    pub repeats: usize,
    /// Every how many-th view of the light field is used, along both axes; see [`thinned`](Self::thinned).
    pub views: usize,
    /// How complex fields are stored.
    pub storage: Storage,
    /// Whether the SLM's levels are optimised for; without, phases are put on them after the fact.
    pub levels: bool,
    /// Whether the SLM is padded as depth and eyebox require.
    pub padding: bool,
    /// Side of a solved pixel in pixels of the SLM, 1 or 2: at 2 a display of half the resolution and twice the pitch is
    /// solved, and each of its pixels shown on 2 x 2.
    pub pixel: usize,
}

impl Default for Recipe {
    /// What a solve does when nothing is asked.
    fn default() -> Self {
        let Settings { steps, pupils, optimizer, diameters, window, .. } = Settings::default();
        Self {
            steps,
            pupils,
            optimizer,
            diameters,
            window,
            repeats: 1,
            views: 1,
            storage: Storage::default(),
            levels: false,
            padding: false,
            pixel: 1,
        }
    }
}

impl Recipe {
    /// Steps of so many pupils by Adam, as its paper draws them.
    pub fn adam(steps: usize, pupils: usize) -> Self {
        let (optimizer, diameters) = (Optimizer::adam(), Diameters::Uniform);
        Self { steps, pupils, optimizer, diameters, ..Self::default() }
    }

    /// The projection with more momentum and a smaller last gain: better by 0.1 dB where steps are a hundred or more and
    /// the window is twice the pupil (docs/measurements.md).
    pub fn momentum() -> Optimizer {
        Optimizer::Projection { gain: [2.5, 0.15], momentum: 0.7, overlap_power: 0.5 }
    }

    /// The built-in recipe of a quality (docs/measurements.md).
    pub fn of(quality: Quality) -> Self {
        let steps = match quality {
            Quality::Fast => 40,
            Quality::Balanced => 192,
            Quality::Accurate => 1024,
        };
        Self { steps, window: WindowFactor::Two, optimizer: Self::momentum(), ..Self::default() }
    }

    /// Whether every number is one that a solve takes.
    pub fn is_sound(&self) -> bool {
        let mut settings = Settings::default();
        self.apply(&mut settings);
        let numbers = match self.optimizer {
            Optimizer::Projection { gain: [a, b], momentum, overlap_power } => [a, b, momentum, overlap_power],
            Optimizer::Adam { rate: [a, b], .. } => [a, b, 0.0, 0.0],
        };
        settings.check().is_ok()
            && numbers.iter().all(|n| (0.0..=1e3).contains(n))
            && (1..=1_000_000).contains(&self.steps)
            && (1..=64).contains(&self.repeats)
            && (1..=64).contains(&self.views)
            && (1..=2).contains(&self.pixel)
    }

    /// Sets what the recipe says. Levels, views, padding and resolution are not a solve's settings:
    /// [`Subject`](super::Subject) applies those.
    pub fn apply(&self, settings: &mut Settings) {
        settings.steps = self.steps;
        settings.pupils = self.pupils;
        settings.optimizer = self.optimizer;
        settings.diameters = self.diameters;
        settings.window = self.window;
        settings.storage = self.storage;
        settings.frames = self.frames(settings.frames);
    }

    /// Follows what was decided about a scene: a window that was asked for in full, and its padding.
    pub fn follow(&mut self, settings: &Settings, padding: Padding) {
        self.window = settings.window;
        self.padding = padding != Padding::default();
    }

    /// Sub-frames that are solved where `shown` are shown.
    pub fn frames(&self, shown: usize) -> usize {
        shown / common_divisor(shown.max(1), self.repeats.max(1))
    }

    /// Whether what is solved is less than the problem: fewer views, or coarser pixels.
    pub fn reduces(&self) -> bool {
        self.views > 1 || self.pixel > 1
    }

    /// The views used of so many along an axis: the first, and how many. They are every n-th, about the same centre; where
    /// that cannot be (of 8 views every second has another centre), n is the next smaller number for which it can.
    pub fn thinned(&self, [rows, columns]: [usize; 2]) -> (usize, [[usize; 2]; 2]) {
        let axis = |count: usize, n: usize| {
            // As many as fit, if what is left over is shared by both ends.
            (1..=count).rev().find(|k| (k - 1) * n < count && (count - 1 - (k - 1) * n).is_multiple_of(2)).map(|k| {
                let first = (count - 1 - (k - 1) * n) / 2;
                [first, k]
            })
        };
        let of =
            |n: usize| Some((n, [axis(rows, n)?, axis(columns, n)?])).filter(|(n, [[r, _], [c, _]])| r < n && c < n);
        (1..=self.views.max(1)).rev().find_map(of).unwrap_or((1, [[0, rows], [0, columns]]))
    }

    /// Whether a display can be solved at the recipe's pixels: both axes are whole in them.
    pub fn fits(&self, display: &Display) -> bool {
        // In the far field coarser pixels would be a narrower field of view.
        self.pixel <= 1
            || display.geometry == Geometry::Relay
                && display.height.is_multiple_of(self.pixel)
                && display.width.is_multiple_of(self.pixel)
    }

    /// The display and the light field that are solved. `None` where the recipe changes neither.
    pub(super) fn scene(&self, field: &LightField, display: &Display) -> Option<(LightField, Display)> {
        let (every, [[top, rows], [left, columns]]) = self.thinned(field.grid);
        let pixel = if self.fits(display) { self.pixel.max(1) } else { 1 };
        if every == 1 && pixel == 1 {
            return None;
        }
        let cell = field.cell(display);
        let places: Vec<usize> = (0..rows)
            .flat_map(|r| (0..columns).map(move |c| (top + every * r) * field.grid[1] + left + every * c))
            .collect();
        let thin = LightField {
            name: field.name.clone(),
            grid: [rows, columns],
            height: field.height,
            width: field.width,
            colors: field.colors.clone(),
            planes: field.planes.iter().map(|views| places.iter().map(|v| views[*v].clone()).collect()).collect(),
            view_pitch: Some(every as f64 * cell),
            disparity: field.disparity.map(|d| d.map(|delta| every as f64 * delta)),
            depth: field.depth,
        };
        if pixel == 1 {
            return Some((thin, display.clone()));
        }
        let coarse = Display {
            height: display.height / pixel,
            width: display.width / pixel,
            pitch: display.pitch * pixel as f64,
            ..display.clone()
        };
        // Pixels are larger by what there are fewer of: depths stay.
        let field = LightField { depth: thin.depth, ..thin.fit(coarse.height, coarse.width, Default::default()) };
        Some((field, coarse))
    }
}

/// Euclid's.
fn common_divisor(a: usize, b: usize) -> usize {
    if b == 0 { a } else { common_divisor(b, a % b) }
}

/// For people, the parts that differ from the default last.
impl std::fmt::Display for Recipe {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let window = match self.window {
            WindowFactor::One => "window 1",
            WindowFactor::Two => "window 2",
            WindowFactor::Full => "full window",
        };
        write!(f, "{} steps of {} pupils, {window}", self.steps, self.pupils)?;
        match self.optimizer {
            Optimizer::Adam { .. } => f.write_str(", Adam")?,
            other if other == Optimizer::projection() => {}
            other if other == Self::momentum() => f.write_str(", momentum 0.7")?,
            Optimizer::Projection { gain: [a, b], momentum, .. } => {
                write!(f, ", gain {a} to {b}, momentum {momentum}")?
            }
        }
        match self.diameters {
            Diameters::LogUniform => {}
            Diameters::Uniform => f.write_str(", diameters uniform")?,
            Diameters::Reciprocal => f.write_str(", diameters uniform in 1/d")?,
        }
        if self.repeats > 1 {
            write!(f, ", each sub-frame shown {} times", self.repeats)?;
        }
        if self.views > 1 {
            write!(f, ", every {} view", ordinal(self.views))?;
        }
        if self.storage != Storage::default() {
            write!(f, ", {}", self.storage.name())?;
        }
        if self.levels {
            f.write_str(", for the SLM's levels")?;
        }
        if self.padding {
            f.write_str(", padded")?;
        }
        if self.pixel > 1 {
            write!(f, ", pixels of {0} x {0}", self.pixel)?;
        }
        Ok(())
    }
}

fn ordinal(n: usize) -> String {
    match n {
        2 => "second".into(),
        3 => "third".into(),
        n => format!("{n}th"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::Color;
    use crate::scene::ViewGrid;
    use proptest::prelude::*;

    fn field(rows: usize, columns: usize) -> LightField {
        LightField {
            name: "x".into(),
            grid: [rows, columns],
            height: 4,
            width: 8,
            colors: vec![Color::Green],
            // Every view says which one it is.
            planes: vec![(0..rows * columns).map(|v| vec![v as f32; 32]).collect()],
            view_pitch: None,
            disparity: Some([-1.0, 2.0]),
            depth: Some([-1e-3, 2e-3]),
        }
    }

    fn display() -> Display {
        Display { height: 4, width: 8, ..Display::preset("small").unwrap() }
    }

    #[test]
    fn the_default_is_what_a_solve_does_and_what_is_said_is_set() {
        let mut settings = Settings::default();
        Recipe::default().apply(&mut settings);
        assert_eq!(settings, Settings::default());
        let recipe = Recipe {
            steps: 7,
            pupils: 3,
            optimizer: Optimizer::adam(),
            diameters: Diameters::Reciprocal,
            window: WindowFactor::Two,
            repeats: 4,
            storage: Storage::F16,
            ..Recipe::default()
        };
        recipe.apply(&mut settings);
        assert_eq!((settings.steps, settings.pupils, settings.frames), (7, 3, 2));
        assert_eq!((settings.optimizer, settings.storage), (Optimizer::adam(), Storage::F16));
        assert_eq!((settings.diameters, settings.window), (Diameters::Reciprocal, WindowFactor::Two));
    }

    #[test]
    fn sub_frames_are_shared_out_evenly() {
        let frames = |repeats, shown| Recipe { repeats, ..Recipe::default() }.frames(shown);
        assert_eq!((frames(1, 8), frames(2, 8), frames(8, 8), frames(16, 8)), (8, 4, 1, 1));
        assert_eq!((frames(2, 7), frames(4, 6), frames(3, 24), frames(2, 0)), (7, 3, 8, 0));
    }

    #[test]
    fn built_in_recipes_are_sound_and_rise() {
        let all = Quality::ALL.map(Recipe::of);
        assert!(all.iter().all(Recipe::is_sound));
        let work = |r: &Recipe| r.steps * r.pupils;
        assert!(work(&all[0]) < work(&all[1]) && work(&all[1]) < work(&all[2]));
        for wrong in [
            Recipe { steps: 0, ..Recipe::default() },
            Recipe { steps: usize::MAX, ..Recipe::default() },
            Recipe { pupils: 0, ..Recipe::default() },
            Recipe { pixel: 3, ..Recipe::default() },
            Recipe { repeats: 0, ..Recipe::default() },
            Recipe { views: 0, ..Recipe::default() },
            Recipe {
                optimizer: Optimizer::Projection { gain: [f64::NAN, 1.0], momentum: 0.5, overlap_power: 0.5 },
                ..Recipe::default()
            },
        ] {
            assert!(!wrong.is_sound(), "{wrong:?}");
        }
    }

    #[test]
    fn what_a_file_does_not_say_is_as_by_default() {
        let read: Recipe = serde_json::from_str(r#"{"steps": 5, "window": "two", "a knob of tomorrow": 1}"#).unwrap();
        assert_eq!(read, Recipe { steps: 5, window: WindowFactor::Two, ..Recipe::default() });
        let all = Recipe { optimizer: Optimizer::adam(), pixel: 2, padding: true, ..Recipe::of(Quality::Balanced) };
        assert_eq!(serde_json::from_str::<Recipe>(&serde_json::to_string(&all).unwrap()).unwrap(), all);
    }

    proptest! {
        /// Views that are left stand where they stood, about the same centre, and see the same pictures.
        #[test]
        fn thinned_views_stay_where_they_are(rows in 1usize..14, columns in 1usize..14, views in 1usize..9) {
            let recipe = Recipe { views, ..Recipe::default() };
            let (whole, display) = (field(rows, columns), display());
            let (every, _) = recipe.thinned(whole.grid);
            prop_assert!(every <= views);
            prop_assert!(views > 2 || every == views || rows % 2 == 0 || columns % 2 == 0);
            let Some((thin, same)) = recipe.scene(&whole, &display) else {
                prop_assert_eq!(every, 1);
                return Ok(());
            };
            prop_assert_eq!(same, display.clone());
            let grid = |f: &LightField| ViewGrid { rows: f.grid[0], columns: f.grid[1], cell: f.cell(&display) };
            prop_assert_eq!(thin.planes[0].len(), thin.grid[0] * thin.grid[1]);
            for (i, view) in thin.planes[0].iter().enumerate() {
                let (x, y) = grid(&thin).position(i);
                let (was_x, was_y) = grid(&whole).position(view[0] as usize);
                prop_assert!((x - was_x).abs() < 1e-12 && (y - was_y).abs() < 1e-12);
            }
            // No other view fits at the ends.
            prop_assert!((thin.grid[0] + 1) * every >= rows && (thin.grid[1] + 1) * every >= columns);
        }
    }

    #[test]
    fn of_nine_views_two_three_and_four_leave_five_and_three() {
        let left = |views| Recipe { views, ..Recipe::default() }.thinned([9, 9]);
        assert_eq!(left(2), (2, [[0, 5]; 2]));
        assert_eq!(left(3), (3, [[1, 3]; 2]));
        assert_eq!(left(4), (4, [[0, 3]; 2]));
        // Every second of eight has another centre.
        assert_eq!(Recipe { views: 2, ..Recipe::default() }.thinned([8, 9]).0, 1);
        assert_eq!(Recipe { views: 3, ..Recipe::default() }.thinned([8, 8]), (3, [[2, 2]; 2]));
    }

    #[test]
    fn coarse_pixels_keep_depths_and_views_and_lose_half_the_eyebox() {
        let (whole, display) = (field(3, 3), display());
        let (coarse, small) = Recipe { pixel: 2, ..Recipe::default() }.scene(&whole, &display).unwrap();
        assert_eq!((small.height, small.width, coarse.height, coarse.width), (2, 4, 2, 4));
        assert!((2.0 * small.eyebox_min() - display.eyebox_min()).abs() < 1e-12);
        assert!((coarse.cell(&small) - whole.cell(&display)).abs() < 1e-12);
        assert_eq!(coarse.depth_range(&small), whole.depth_range(&display));
        // The same depths by disparity, where none are stated.
        let free = LightField { depth: None, ..whole.clone() };
        let (thin, small) = Recipe { pixel: 2, ..Recipe::default() }.scene(&free, &display).unwrap();
        let (a, b) = (thin.depth_range(&small).unwrap(), free.depth_range(&display).unwrap());
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9), "{a:?} {b:?}");
        // Odd sizes cannot be.
        let odd = Display { width: 7, ..display };
        assert!(Recipe { pixel: 2, ..Recipe::default() }.scene(&whole, &odd).is_none());
    }
}
