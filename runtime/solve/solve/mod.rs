//! Solves holograms by Stochastic Light Field Holography (Schiffers et al. 2023) and related methods.
//!
//! A step draws pupils, compares the images of the wave with images of the light field, and moves the phases. One
//! implementation serves every engine and both optimizers. The wave propagates to the retina by the angular spectrum
//! method. One of two optimizers ([`Optimizer`]) moves the phases. The pupil-wise projection replaces amplitudes, as
//! Gerchberg and Saxton do, and combines the changes of many pupils, as ptychography does. Adam follows the Wirtinger
//! gradient.

mod begin;
mod best;
mod carry;
mod cost;
mod dpac;
#[cfg(feature = "vulkan")]
mod dry_run;
mod error;
mod exposure;
mod eye;
mod joint;
mod levels;
mod method;
mod motion;
#[cfg(test)]
mod motion_tests;
mod optimizer;
mod outcome;
pub(crate) mod pace;
mod problem;
mod rates;
mod refine_settings;
mod run;
mod sampling;
mod scene_plan;
#[cfg(test)]
mod seen_tests;
mod settings;
mod solver;
mod source;
mod start_table;
#[cfg(all(test, feature = "vulkan"))]
mod statistics_tests;
mod steer;
#[cfg(test)]
mod steer_tests;
mod step;
mod validation;
mod viewpoints;

pub use begin::{solve, solve_from};
pub use best::{BestKeeper, BestState, Refinable, RefinedStep, refine};
pub use cost::{Cost, Forecast, Loaded, forecast, model_work};
#[cfg(feature = "vulkan")]
pub use dry_run::{DryRun, DryRunStep};
pub use error::SolveError;
pub use exposure::BrightEnd;
pub use eyebox_base::random::SplitMix;
pub use joint::{JointPart, JointProblem, JointRefiner, JointSolution, solve_joint};
pub use joint::{SharedDrives, for_joint_colors};
pub use levels::{Levels, even_levels};
pub use method::Method;
pub use motion::Motion;
pub use optimizer::Optimizer;
pub use optimizer::cosine;
pub use outcome::{Flow, Progress, Solution, Stop, Warm};
#[cfg(any(test, feature = "test-hooks"))]
pub use pace::Pace;
pub use problem::Problem;
pub use rates::Rates;
pub use refine_settings::{RefineSettings, Strategy};
pub(crate) use run::exposure_under;
pub use sampling::{Diameters, PupilRange, Sampler, Sequence, pupils_of, random_phases};
pub use scene_plan::{Decision, Full, PlanRequest, ScenePlan};
pub use settings::{FirstPhases, Joint, PaddingRule, Settings};
pub use start_table::StartTable;
pub use steer::Refiner;
pub use step::{Update, take_seen};
pub(crate) use step::{release_early, strides, take};
pub use validation::{ValidationScore, Validator};
