//! The settings that trade quality for time.
//!
//! They are steps, pupils, optimizer, diameters, window, repeats, views, storage, levels, padding and pixels.

use super::Quality;
use crate::optics::{Display, Geometry, WindowFactor};
use crate::plan::Storage;
use crate::scene::LightField;
use crate::solve::{Diameters, Levels, Optimizer, PaddingRule, Settings};

impl Settings {
    /// Returns settings for `steps` steps of `pupils` pupils by Adam, with diameters drawn as in the paper.
    pub fn adam(steps: usize, pupils: usize) -> Self {
        let (optimizer, diameters) = (Optimizer::adam(), Diameters::Uniform);
        Self { steps, pupils, optimizer, diameters, ..Self::default() }
    }

    /// Returns the built-in settings of a quality (docs/results/speed-and-accuracy.json).
    pub fn of(quality: Quality) -> Self {
        let steps = match quality {
            Quality::Fast => 40,
            Quality::Balanced => 192,
            Quality::Accurate => 1024,
        };
        Self { steps, window: WindowFactor::Two, optimizer: Optimizer::momentum(), ..Self::default() }
    }

    /// Returns true if a solve accepts every number.
    pub fn is_sound(&self) -> bool {
        let numbers = match self.optimizer {
            Optimizer::Projection { gain: [a, b], momentum, overlap_power } => [a, b, momentum, overlap_power],
            Optimizer::Adam { rate: [a, b], .. } => [a, b, 0.0, 0.0],
        };
        self.check().is_ok()
            && numbers.iter().all(|n| (0.0..=1e3).contains(n))
            && (1..=1_000_000).contains(&self.steps)
            && (1..=64).contains(&self.repeats)
            && (1..=64).contains(&self.views)
            && (1..=2).contains(&self.pixel)
    }

    /// Returns true if the solved problem is smaller than the whole one, by fewer views or coarser pixels.
    pub fn reduces(&self) -> bool {
        self.views > 1 || self.pixel > 1
    }

    /// Returns the step between used views and, per axis, the first view and the number of views.
    ///
    /// Used views are every n-th view with the same center. If n allows no such views (every second of 8 views has
    /// another center), n is the next smaller number that does.
    pub fn thinned(&self, [rows, columns]: [usize; 2]) -> (usize, [[usize; 2]; 2]) {
        let axis = |count: usize, n: usize| {
            // It is the largest number of views whose remainder is shared equally by both ends.
            (1..=count).rev().find(|k| (k - 1) * n < count && (count - 1 - (k - 1) * n).is_multiple_of(2)).map(|k| {
                let first = (count - 1 - (k - 1) * n) / 2;
                [first, k]
            })
        };
        let of =
            |n: usize| Some((n, [axis(rows, n)?, axis(columns, n)?])).filter(|(n, [[r, _], [c, _]])| r < n && c < n);
        (1..=self.views.max(1)).rev().find_map(of).unwrap_or((1, [[0, rows], [0, columns]]))
    }

    /// Returns true if a display can be solved at these pixels, so that both axes are whole numbers of them.
    pub fn fits(&self, display: &Display) -> bool {
        // Coarser pixels of a far field would narrow the field of view.
        self.pixel <= 1
            || display.geometry == Geometry::Relay
                && display.height.is_multiple_of(self.pixel)
                && display.width.is_multiple_of(self.pixel)
    }

    /// Returns the solved display, with coarser pixels if possible.
    pub(super) fn coarser(&self, display: &Display) -> Display {
        let pixel = if self.fits(display) { self.pixel.max(1) } else { 1 };
        Display {
            height: display.height / pixel,
            width: display.width / pixel,
            pitch: display.pitch * pixel as f64,
            ..display.clone()
        }
    }

    /// Returns the solved light field and display, or `None` for the whole ones.
    pub(super) fn scene(&self, field: &LightField, display: &Display) -> Option<(LightField, Display)> {
        let (every, [[top, rows], [left, columns]]) = self.thinned(field.grid);
        let coarse = self.coarser(display);
        if every == 1 && coarse == *display {
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
            made: None,
        };
        if coarse == *display {
            return Some((thin, coarse));
        }
        // Pixels become larger by the same factor, so depths stay.
        let field = LightField { depth: thin.depth, ..thin.fit(coarse.height, coarse.width, Default::default()) };
        Some((field, coarse))
    }
}

/// Describes the fields that trade quality for time. Fields that differ from the default come last.
impl std::fmt::Display for Settings {
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
            other if other == Optimizer::momentum() => f.write_str(", momentum 0.7")?,
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
        if self.levels != Levels::Any {
            f.write_str(", for the SLM's levels")?;
        }
        match self.padding {
            PaddingRule::Never => {}
            PaddingRule::Exact => f.write_str(", as wide as the SLM")?,
            PaddingRule::Need | PaddingRule::Always => f.write_str(", padded")?,
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
            // Every view contains its own number.
            planes: vec![(0..rows * columns).map(|v| vec![v as f32; 32]).collect()],
            view_pitch: None,
            disparity: Some([-1.0, 2.0]),
            depth: Some([-1e-3, 2e-3]),
            made: None,
        }
    }

    fn display() -> Display {
        Display { height: 4, width: 8, ..Display::preset("small").unwrap() }
    }

    #[test]
    fn quality_is_taken_over_and_the_scene_stays() {
        let scene =
            Settings { depth: [0.0, 1e-3], seed: 7, levels: Levels::Given(vec![0.0, 3.0]), ..Settings::default() };
        assert_eq!(scene.with_quality_of(&Settings::default()), scene);
        let quality = Settings {
            steps: 7,
            pupils: 3,
            optimizer: Optimizer::adam(),
            diameters: Diameters::Reciprocal,
            window: WindowFactor::Two,
            repeats: 4,
            views: 2,
            storage: Storage::F16,
            padding: PaddingRule::Always,
            pixel: 2,
            ..Settings::default()
        };
        let (depth, seed, levels) = (scene.depth, scene.seed, scene.levels.clone());
        assert_eq!(scene.with_quality_of(&quality), Settings { depth, seed, levels, ..quality.clone() });
        let own = Settings { levels: Levels::Display, ..quality };
        assert_eq!(scene.with_quality_of(&own).levels, Levels::Display);
    }

    #[test]
    fn sub_frames_are_shared_out_evenly() {
        let solved = |repeats, frames| Settings { repeats, frames, ..Settings::default() }.solved_frames();
        assert_eq!((solved(1, 8), solved(2, 8), solved(8, 8), solved(16, 8)), (8, 4, 1, 1));
        assert_eq!((solved(2, 7), solved(4, 6), solved(3, 24), solved(2, 0)), (7, 3, 8, 0));
    }

    #[test]
    fn built_in_recipes_are_sound_and_rise() {
        let all = Quality::ALL.map(Settings::of);
        assert!(all.iter().all(Settings::is_sound));
        let work = |r: &Settings| r.steps * r.pupils;
        assert!(work(&all[0]) < work(&all[1]) && work(&all[1]) < work(&all[2]));
        for wrong in [
            Settings { steps: 0, ..Settings::default() },
            Settings { steps: usize::MAX, ..Settings::default() },
            Settings { pupils: 0, ..Settings::default() },
            Settings { pixel: 3, ..Settings::default() },
            Settings { repeats: 0, ..Settings::default() },
            Settings { views: 0, ..Settings::default() },
            Settings {
                optimizer: Optimizer::Projection { gain: [f64::NAN, 1.0], momentum: 0.5, overlap_power: 0.5 },
                ..Settings::default()
            },
        ] {
            assert!(!wrong.is_sound(), "{wrong:?}");
        }
    }

    #[test]
    fn what_a_file_does_not_say_is_as_by_default() {
        let read = |text: &str| serde_json::from_str::<Settings>(text).unwrap();
        let short = read(r#"{"steps": 5, "window": "two", "a setting of tomorrow": 1}"#);
        assert_eq!(short, Settings { steps: 5, window: WindowFactor::Two, ..Settings::default() });
        let (padding, levels) = (PaddingRule::Need, Levels::Given(vec![0.0, 1.5]));
        let all =
            Settings { optimizer: Optimizer::adam(), pixel: 2, padding, levels, ..Settings::of(Quality::Balanced) };
        assert_eq!(read(&serde_json::to_string(&all).unwrap()), all);
    }

    /// Measured settings and holograms of earlier versions had a switch for levels and padding, or a list of levels.
    #[test]
    fn settings_of_earlier_versions_are_read() {
        let read = |text: &str| serde_json::from_str::<Settings>(text).unwrap();
        let measured = read(
            r#"{"steps": 40, "pupils": 16, "optimizer": {"kind": "projection", "gain": [2.5, 0.15], "momentum": 0.7,
                "overlap_power": 0.5}, "diameters": "log-uniform", "window": "two", "repeats": 2, "views": 2,
                "storage": "fp16", "levels": true, "padding": true, "pixel": 2}"#,
        );
        let (levels, padding) = (Levels::Display, PaddingRule::Always);
        let reduced = Settings { repeats: 2, views: 2, pixel: 2, storage: Storage::F16, ..Settings::default() };
        let of = Settings::of(Quality::Fast);
        let wanted =
            Settings { steps: of.steps, window: of.window, optimizer: of.optimizer, levels, padding, ..reduced };
        assert_eq!(measured, wanted);
        let plain = read(r#"{"levels": false, "padding": false, "frames": 4}"#);
        assert_eq!(plain, Settings { frames: 4, ..Settings::default() });
        assert_eq!(read(r#"{"levels": [0.0, 2.5]}"#).levels, Levels::Given(vec![0.0, 2.5]));
        assert_eq!(read(r#"{"levels": null}"#).levels, Levels::Any);
    }

    proptest! {
        /// The remaining views keep their positions, center and pictures.
        #[test]
        fn thinned_views_stay_where_they_are(rows in 1usize..14, columns in 1usize..14, views in 1usize..9) {
            let recipe = Settings { views, ..Settings::default() };
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
        let left = |views| Settings { views, ..Settings::default() }.thinned([9, 9]);
        assert_eq!(left(2), (2, [[0, 5]; 2]));
        assert_eq!(left(3), (3, [[1, 3]; 2]));
        assert_eq!(left(4), (4, [[0, 3]; 2]));
        // Every second of eight views has another center.
        assert_eq!(Settings { views: 2, ..Settings::default() }.thinned([8, 9]).0, 1);
        assert_eq!(Settings { views: 3, ..Settings::default() }.thinned([8, 8]), (3, [[2, 2]; 2]));
    }

    #[test]
    fn coarse_pixels_keep_depths_and_views_and_lose_half_the_eyebox() {
        let (whole, display) = (field(3, 3), display());
        let (coarse, small) = Settings { pixel: 2, ..Settings::default() }.scene(&whole, &display).unwrap();
        assert_eq!((small.height, small.width, coarse.height, coarse.width), (2, 4, 2, 4));
        assert!((2.0 * small.eyebox_min() - display.eyebox_min()).abs() < 1e-12);
        assert!((coarse.cell(&small) - whole.cell(&display)).abs() < 1e-12);
        assert_eq!(coarse.depth_range(&small), whole.depth_range(&display));
        // Disparities give the same depths if none are stated.
        let free = LightField { depth: None, ..whole.clone() };
        let (thin, small) = Settings { pixel: 2, ..Settings::default() }.scene(&free, &display).unwrap();
        let (a, b) = (thin.depth_range(&small).unwrap(), free.depth_range(&display).unwrap());
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9), "{a:?} {b:?}");
        // Odd sizes are not possible.
        let odd = Display { width: 7, ..display };
        assert!(Settings { pixel: 2, ..Settings::default() }.scene(&whole, &odd).is_none());
    }
}
