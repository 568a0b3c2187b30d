//! Stochastic Light Field Holography (Schiffers et al. 2023): draws pupils, compares what the wave gives with what the
//! light field gives, moves the phases. Written once, for every engine and both optimisers.
//!
//! May import everything above it: `optics`, `scene`, `plan`, `engine`, `evaluate`.

mod dpac;
mod exposure;
mod fault;
mod forecast;
mod judge;
mod method;
mod problem;
mod run;
mod sampling;
mod scene_plan;
mod settings;
mod solver;
mod steer;
#[cfg(test)]
mod steer_tests;
mod step;

pub(crate) use exposure::BrightEnd;
pub use forecast::{Forecast, Loaded, Rate, Rates, forecast};
pub use judge::{Judge, Verdict};
pub use method::Method;
pub use problem::Problem;
pub use sampling::{Diameters, PupilRange, Sampler, Sequence, SplitMix, pupils_of, random_phases};
pub use scene_plan::{Choice, Full, PaddingRule, ScenePlan, TOLERANCE, Wish};
pub(crate) use settings::level_table;
pub use settings::{Optimizer, Settings, cosine, even_levels};
pub use solver::{Flow, Progress, Solution, SolveError, Stop, Warm, solve, solve_from};
pub use steer::{Refiner, Steering, Strategy};
pub(crate) use step::{Update, mean_loss, take};
