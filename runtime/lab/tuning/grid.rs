//! Lists the recipes to try, in an order that can end anywhere.
//!
//! The first recipe is the default. Then come as many steps as a trial has time for, and about a fifth and a twentieth
//! of them, where `balanced` and `fast` are expected. Then each setting is changed alone from the default. The grid
//! itself has steps, windows and optimizers. For the shorter recipes, the same work is also divided into fewer and more
//! pupils per step.

use eyebox::low_level::optics::WindowFactor;
use eyebox::low_level::plan::Storage;
use eyebox::low_level::solve::{Diameters, Levels, Optimizer, PaddingRule, Settings};

/// The limits of the choices.
#[derive(Debug, Clone, Copy)]
pub(super) struct Space {
    /// The number of shown sub-frames.
    pub frames: usize,
    /// Rows and columns of views.
    pub views: [usize; 2],
    /// True if the engine saves time or memory by storing fields as halves.
    pub halves: bool,
    /// True if the solver can optimize for the SLM's levels.
    pub levels: bool,
    /// True if the scene requires padding.
    pub padding: bool,
    /// True if the SLM can be solved at half its resolution.
    pub pixel: bool,
}

/// The shares of the longest trial's steps. The first is all of them. The next two are a little less than balanced and
/// fast may take, and the others are between.
const PARTS: [f64; 7] = [1.0, 0.185, 0.045, 0.5, 0.1, 0.15, 0.022];
/// Shares up to this value are also tried with other numbers of pupils.
const SHORT: f64 = 0.2;

/// Lists each recipe once. The longest trial has `longest` steps of 16 pupils with a window of 2.
pub(super) fn grid(space: &Space, longest: usize) -> Vec<Settings> {
    let spine = |part: f64, pupils: usize, window: WindowFactor, optimizer: Optimizer| {
        let steps = (longest as f64 * part * 16.0 / pupils as f64).round().max(1.0) as usize;
        Settings { steps, pupils, window, optimizer, ..Settings::default() }
    };
    let mut all = vec![Settings::default()];
    all.extend(PARTS[..3].iter().map(|p| spine(*p, 16, WindowFactor::Two, Optimizer::momentum())));
    all.extend(alone(space));
    for optimizer in [Optimizer::momentum(), Optimizer::projection()] {
        for window in [WindowFactor::Two, WindowFactor::One] {
            let long = PARTS.iter().filter(|p| optimizer == Optimizer::momentum() || **p <= SHORT);
            all.extend(long.map(|p| spine(*p, 16, window, optimizer)));
        }
    }
    for pupils in [8, 32] {
        let short = PARTS.iter().filter(|p| **p <= SHORT);
        let both = short.flat_map(|p| [WindowFactor::Two, WindowFactor::One].map(|w| (*p, w)));
        all.extend(both.map(|(p, window)| spine(p, pupils, window, Optimizer::momentum())));
    }
    all.push(Settings::adam(200, 8));
    let mut once: Vec<Settings> = Vec::new();
    for recipe in all {
        if !once.contains(&recipe) {
            once.push(recipe);
        }
    }
    once
}

/// Lists each setting alone, well away from the default. Settings that reduce the problem or add to it are listed only
/// if they have an effect. The rest of the grid varies the steps.
fn alone(space: &Space) -> Vec<Settings> {
    let start = Settings::default;
    let thins = |n: usize| {
        let (every, [[_, rows], [_, columns]]) = Settings { views: n, ..start() }.thinned(space.views);
        every == n && rows.max(columns) >= 2
    };
    let all = [
        (true, Settings { window: WindowFactor::Two, ..start() }),
        (true, Settings { pupils: start().pupils / 2, ..start() }),
        (true, Settings { pupils: start().pupils * 2, ..start() }),
        (true, Settings { optimizer: Optimizer::momentum(), ..start() }),
        (true, Settings { diameters: Diameters::Uniform, ..start() }),
        (true, Settings { diameters: Diameters::Reciprocal, ..start() }),
        (thins(2), Settings { views: 2, ..start() }),
        (thins(3), Settings { views: 3, ..start() }),
        (space.frames.is_multiple_of(2), Settings { repeats: 2, ..start() }),
        (space.padding, Settings { padding: PaddingRule::Always, ..start() }),
        (space.halves, Settings { storage: Storage::F16, ..start() }),
        (space.levels, Settings { levels: Levels::Display, ..start() }),
        (space.pixel, Settings { pixel: 2, ..start() }),
        (true, Settings { window: WindowFactor::Full, ..start() }),
    ];
    all.into_iter().filter(|a| a.0).map(|a| a.1).collect()
}

#[cfg(test)]
mod tests {
    use super::super::{Trial, recommend};
    use super::*;

    const SPACE: Space = Space { frames: 8, views: [9, 9], halves: true, levels: true, padding: true, pixel: true };

    #[test]
    fn every_setting_is_tried_once_and_only_where_it_is_something() {
        let all = grid(&SPACE, 1024);
        assert_eq!(all[0], Settings::default());
        assert!(all.iter().enumerate().all(|(i, r)| r.is_sound() && !all[..i].contains(r)));
        let any = |f: &dyn Fn(&Settings) -> bool| all.iter().any(f);
        assert!(any(&|r| r.views == 2) && any(&|r| r.views == 3) && any(&|r| r.repeats > 1) && any(&|r| r.pixel > 1));
        assert!(
            any(&|r| r.padding != PaddingRule::Never)
                && any(&|r| r.levels != Levels::Any)
                && any(&|r| r.storage == Storage::F16)
        );
        assert!(any(&|r| r.window == WindowFactor::Full) && any(&|r| r.steps == 1024) && any(&|r| r.pupils == 32));
        assert!(any(&|r| matches!(r.optimizer, Optimizer::Adam { .. })));
        let small = Space { frames: 1, views: [1, 1], halves: false, levels: false, padding: false, pixel: false };
        let plain = |r: &Settings| {
            r.repeats == 1 && r.views == 1 && r.pixel == 1 && r.padding == PaddingRule::Never && r.levels == Levels::Any
        };
        assert!(grid(&small, 1).iter().all(|r| plain(r) && r.is_sound()));
    }

    #[test]
    fn the_first_of_the_grid_have_what_is_recommended() {
        // On this model machine, time is work, and quality has diminishing returns.
        let measure = |r: &Settings| {
            let ms = 20.0 + (r.steps * r.pupils) as f64;
            let db = 31.0 - 60.0 / ((r.steps * r.pupils) as f64).powf(0.7);
            Trial::new(r.clone(), ms, vec![db], 1)
        };
        let trials: Vec<Trial> = grid(&SPACE, 1024)[..4].iter().map(measure).collect();
        assert!(recommend(&trials).unwrap().iter().all(|r| r.met), "{trials:?}");
    }
}
