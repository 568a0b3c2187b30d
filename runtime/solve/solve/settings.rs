//! What can be chosen about a solve: one type for the library, the command, measured settings and a hologram's file.

use super::error::{SolveError, require};
use super::levels::Levels;
use super::method::Method;
use super::motion::Motion;
use super::optimizer::Optimizer;
use super::sampling::{Diameters, PupilRange, Sequence};
use crate::engine::Memory;
use crate::optics::WindowFactor;
use crate::plan::Storage;
use eyebox_kernels::Complex32;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};

/// Whether the SLM is padded where the scene requires it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum PaddingRule {
    /// Never: the edges see a little of what walks off on the other side.
    #[default]
    Never,
    /// Where what walks off would cost more than 0.05 dB.
    Need,
    /// As wide as light walks off.
    Always,
    /// Never, and a side that [transforms slowly](crate::optics::Padding::smooth) stays as it is.
    Exact,
}

/// What a solve begins with, if no phases are given.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum FirstPhases {
    /// Phases that a table has for the picture ([`StartTable`](super::StartTable)), where the display has one.
    #[default]
    Table,
    /// Random phases, as in the paper.
    Random,
}

/// How all colours share their sub-frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Joint {
    /// Times that white is to be brighter than of one colour after another, by lasers of the same peak power: 1 to the number of
    /// colours. Powers are then at most the number of colours over it, times their mean: the brightest leaves them all alike.
    pub brightness: f64,
}

impl Default for Joint {
    fn default() -> Self {
        Self { brightness: 1.0 }
    }
}

/// No length of an eye or a scene is larger, metres: what is computed of one stays a number.
const FARTHEST: f64 = 1e3;
/// Least share of the velocity that is kept where colours share their drives: what they ask for differs, and evens out over several steps
/// (measured: 0.4 dB of the mean and 1 dB of the worst pupil more than a half, on an SLM of two turns).
const JOINT_MOMENTUM: f64 = 0.7;

/// Everything that decides a solve, besides the scene and the display.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Settings {
    /// Sub-frames that are shown, optimised jointly on their mean intensity.
    pub frames: usize,
    /// How often each solved sub-frame is shown: 2 solves half of them. What does not divide the number shown counts as
    /// the largest number that divides both.
    #[serde(skip_serializing_if = "is_one")]
    pub repeats: usize,
    /// What is looked through, and from which first phases.
    pub method: Method,
    /// What it begins with, if no phases are given: a table's phases where the display has one.
    #[serde(skip_serializing_if = "is_default")]
    pub first_phases: FirstPhases,
    /// How phases are moved. A file may name it alone.
    #[serde(deserialize_with = "optimizer")]
    pub optimizer: Optimizer,
    /// Steps, at most.
    pub steps: usize,
    /// Pupils per step.
    pub pupils: usize,
    /// Seconds, at most; the schedule follows whichever of steps and seconds runs out first.
    pub seconds: Option<f64>,
    /// Stop once the validation pupils' mean PSNR reaches this, dB.
    pub psnr: Option<f64>,
    /// Part of the light that the pupils are to see: mean of the target over the exposure. None: chosen from the scene.
    pub efficiency: Option<f64>,
    /// Window per pupil; in files also 1 or 2.
    #[serde(deserialize_with = "window")]
    pub window: WindowFactor,
    /// Diameters drawn, metres.
    pub diameter: [f64; 2],
    /// Focus depths drawn, metres.
    pub depth: [f64; 2],
    /// Distribution of diameters.
    pub diameters: Diameters,
    /// Sequence of pupils.
    pub sequence: Sequence,
    /// Decides the first phases and the pupils.
    pub seed: u64,
    /// Diameter of the STFT's circular Fourier filter, over the eyebox's side ([`Method::Stft`]; Choi et al. 2022).
    pub stft_filter: f64,
    /// Pixels of the STFT's window along each axis; None: the number of views.
    pub stft_samples: Option<usize>,
    /// Weight of the light's evenness over the eyebox ([`Method::PupilAware`]); the share of the way to an even eyebox
    /// that a step of the projection asks for, or the factor of the term in Adam's loss.
    pub evenness: f64,
    /// Patches of the eyebox along each axis, 1 to 16, whose light is evened out.
    pub patches: usize,
    /// Phases that the SLM can show.
    pub levels: Levels,
    /// When the SLM is padded with zeros. What a [`Problem`](super::Problem) is made with: [`ScenePlan`](super::ScenePlan)
    /// and [`quality::ColorJob`](crate::quality::ColorJob) follow it.
    #[serde(deserialize_with = "padding", skip_serializing_if = "is_default")]
    pub padding: PaddingRule,
    /// Every how many-th view of the light field is used, along both axes; a [`quality::ColorJob`](crate::quality::ColorJob)
    /// thins them.
    #[serde(skip_serializing_if = "is_one")]
    pub views: usize,
    /// Side of a solved pixel in pixels of the SLM, 1 or 2: at 2 a [`quality::ColorJob`](crate::quality::ColorJob) solves a
    /// display of half the resolution and twice the pitch, and each of its pixels is shown on 2 x 2.
    #[serde(skip_serializing_if = "is_one")]
    pub pixel: usize,
    /// Whether every pupil is given all modes of the source; wide ones are given fewer where that leaves their speckle as it is.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub all_modes: bool,
    /// What moves while the sub-frames are lit: pupils are drawn so ([`Method::Slfh`] and the methods of focal stacks).
    #[serde(skip_serializing_if = "Motion::is_still")]
    pub motion: Motion,
    /// All colours at once, in sub-frames that they share; none for one colour after another. What takes all colours of a
    /// scene follows it ([`solve_joint`](super::solve_joint)).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joint: Option<Joint>,
    /// Bytes that the windows of pupils in flight may take: as float32, so that halves take half of it; in a device's own
    /// memory twice as many, as they are stored there.
    pub window_bytes: usize,
    /// How complex fields are stored while solving: halves take half the memory, at a price (docs/measurements.md).
    pub storage: Storage,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            frames: 8,
            repeats: 1,
            method: Method::Slfh,
            first_phases: FirstPhases::Table,
            optimizer: Optimizer::projection(),
            steps: 60,
            pupils: 16,
            seconds: None,
            psnr: None,
            efficiency: None,
            window: WindowFactor::One,
            diameter: [2e-3, 20e-3],
            depth: [-3e-3, 3e-3],
            diameters: Diameters::LogUniform,
            sequence: Sequence::Sobol,
            seed: 0,
            stft_filter: 0.95,
            stft_samples: None,
            evenness: 0.5,
            patches: 9,
            levels: Levels::Any,
            padding: PaddingRule::Never,
            views: 1,
            pixel: 1,
            all_modes: false,
            motion: Motion::default(),
            joint: None,
            window_bytes: 256 << 20,
            storage: Storage::F32,
        }
    }
}

impl Settings {
    /// Values of the windows of pupils in flight, on an engine whose buffers lie there. More at once are fewer stages for a
    /// device, and nothing for the host.
    pub(crate) fn in_flight(&self, memory: Memory) -> usize {
        match memory {
            Memory::Device => 2 * self.window_bytes / self.storage.bytes(),
            Memory::Host | Memory::Shared => self.window_bytes / size_of::<Complex32>(),
        }
    }

    /// Pupils that are drawn in an eyebox of this side, metres.
    pub(crate) fn pupil_range(&self, eyebox: f64) -> PupilRange {
        PupilRange { eyebox, diameter: self.diameter, depth: self.depth, diameters: self.diameters }
    }

    /// Steps of the projection that move light as far as these steps do.
    pub(super) fn steps_of_projection(&self) -> usize {
        /// Steps of Adam that do what one step of the projection does (docs/measurements.md).
        const ADAM: usize = 10;
        if matches!(self.optimizer, Optimizer::Adam { .. }) { self.steps / ADAM } else { self.steps }
    }

    /// Sub-frames that are solved: `repeats` of them are alike where that divides them.
    pub fn solved_frames(&self) -> usize {
        fn common_divisor(a: usize, b: usize) -> usize {
            if b == 0 { a } else { common_divisor(b, a % b) }
        }
        self.frames / common_divisor(self.frames.max(1), self.repeats.max(1))
    }

    /// These as the solver takes them: the sub-frames that are solved, and the optimiser that the method asks for.
    pub(super) fn as_computed(&self) -> Self {
        let frames = if self.method.repeats_frames() { 1 } else { self.solved_frames() };
        let optimizer = match (self.method, self.optimizer) {
            (Method::Smooth, Optimizer::Projection { .. }) => Optimizer::adam(),
            (_, optimizer) => optimizer,
        };
        Self { frames, repeats: 1, optimizer, ..self.clone() }
    }

    /// These, with everything of `other` that trades quality for time. What stays (depths, diameters, seed, sub-frames
    /// shown, levels that are given, method) belongs to the scene and the display.
    pub fn with_quality_of(&self, other: &Self) -> Self {
        let Self { steps, pupils, optimizer, diameters, window, repeats, views, storage, padding, pixel, .. } = *other;
        let levels = if other.levels == Levels::Display { Levels::Display } else { self.levels.clone() };
        let exact = padding == PaddingRule::Never && self.padding == PaddingRule::Exact;
        let padding = if exact { PaddingRule::Exact } else { padding };
        Self {
            steps,
            pupils,
            optimizer,
            diameters,
            window,
            repeats,
            views,
            storage,
            levels,
            padding,
            pixel,
            ..self.clone()
        }
    }

    /// These as all colours at once are solved by: of all pixels, views and sub-frames, in float32.
    pub fn for_joint_colors(&self) -> Self {
        let optimizer = match self.optimizer {
            Optimizer::Projection { gain, momentum, overlap_power } => {
                Optimizer::Projection { gain, momentum: momentum.max(JOINT_MOMENTUM), overlap_power }
            }
            other => other,
        };
        Self { repeats: 1, pixel: 1, views: 1, storage: Storage::F32, optimizer, ..self.clone() }
    }

    /// Refuses what all colours at once do not have.
    fn check_joint(&self) -> Result<(), SolveError> {
        let Some(Joint { brightness }) = self.joint else { return Ok(()) };
        let is_bright = brightness >= 1.0 && brightness.is_finite();
        require(is_bright, "the brightness of joint colours", brightness, "1 to the number of colours")?;
        let is_joint = matches!(self.method, Method::Slfh | Method::Lf2fs | Method::StftExact);
        let right = "slfh, lf2fs or stft-exact for all colours at once";
        require(is_joint, "the method", self.method.name(), right)?;
        let right = "any phase for all colours at once";
        require(self.levels == Levels::Any, "the choice of phase levels", "given", right)?;
        require(self.motion.is_still(), "the motion", "given", "none for all colours at once")
    }

    /// Refuses settings that cannot be.
    ///
    /// # Errors
    /// [`SolveError::Setting`].
    pub fn check(&self) -> Result<(), SolveError> {
        let mm = |[a, b]: [f64; 2]| format!("{}..{}", a * 1e3, b * 1e3);
        let ([low, high], [near, far]) = (self.diameter, self.depth);
        require((1..=4096).contains(&self.frames), "the number of sub-frames", self.frames, "1 to 4096")?;
        require((1..=65536).contains(&self.pupils), "the number of pupils a step", self.pupils, "1 to 65536")?;
        let (what, right) = ("the range of pupil diameters (mm)", "positive, smallest first, at most 1e6");
        require(low > 0.0 && low <= high && high <= FARTHEST, what, mm(self.diameter), right)?;
        let (what, right) = ("the range of depths (mm)", "within 1e6, smallest first");
        require(near <= far && -FARTHEST <= near && far <= FARTHEST, what, mm(self.depth), right)?;
        let (filter, right) = (self.stft_filter, "above 0, at most 2: times the eyebox");
        require(filter > 0.0 && filter <= 2.0, "the diameter of the STFT's filter", filter, right)?;
        if let Some(samples) = self.stft_samples {
            require((1..=256).contains(&samples), "the window of the STFT (samples)", samples, "1 to 256")?;
        }
        let what = "the weight of the eyebox's evenness";
        require((0.0..=1e6).contains(&self.evenness), what, self.evenness, "0 to 1e6")?;
        let patches = 1..=eyebox_kernels::energy::MOST as usize;
        let what = "the number of patches along the eyebox";
        require(patches.contains(&self.patches), what, self.patches, "1 to 16")?;
        if let Some(psnr) = self.psnr {
            require(psnr.is_finite(), "the PSNR to stop at (dB)", psnr, "a finite number, such as 30")?;
        }
        if let Some(levels) = self.levels.given() {
            let count = 1..=eyebox_kernels::quantise::MOST;
            require(count.contains(&levels.len()), "the number of phase levels", levels.len(), "1 to 256")?;
            for level in levels {
                let right = "a finite number of ordinary size";
                require(level.is_finite() && level.abs() < 1e6, "a phase level (rad)", level, right)?;
            }
        }
        self.motion.check(self.solved_frames())?;
        self.check_joint()?;
        let Some(efficiency) = self.efficiency else { return Ok(()) };
        require(efficiency > 0.0 && efficiency <= 1.0, "the efficiency", efficiency, "above 0, at most 1")
    }
}

// What is as by default is left out: files stay those of earlier versions, which go on where they were cut off.
fn is_one(n: &usize) -> bool {
    *n == 1
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// A rule, or the switch that earlier versions wrote.
fn padding<'de, D: Deserializer<'de>>(from: D) -> Result<PaddingRule, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Stored {
        Switch(bool),
        Rule(PaddingRule),
    }
    Ok(match Stored::deserialize(from)? {
        Stored::Switch(false) => PaddingRule::Never,
        Stored::Switch(true) => PaddingRule::Always,
        Stored::Rule(rule) => rule,
    })
}

/// An optimizer, or its name alone.
fn optimizer<'de, D: Deserializer<'de>>(from: D) -> Result<Optimizer, D::Error> {
    whole_or_name(from, Optimizer::projection(), Optimizer::adam())
}

/// A value as a whole, or one of two by its name alone.
pub(super) fn whole_or_name<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    from: D,
    projection: T,
    adam: T,
) -> Result<T, D::Error> {
    #[derive(Deserialize)]
    #[serde(rename_all = "lowercase")]
    enum Name {
        Projection,
        Adam,
    }
    #[derive(Deserialize)]
    #[serde(untagged, expecting = "expected projection, adam, or a table with kind and its numbers")]
    enum Stored<T> {
        Name(Name),
        Whole(T),
    }
    Ok(match Stored::deserialize(from)? {
        Stored::Name(Name::Projection) => projection,
        Stored::Name(Name::Adam) => adam,
        Stored::Whole(whole) => whole,
    })
}

/// A window by its name, or as times the pupil.
pub(super) fn window<'de, D: Deserializer<'de>>(from: D) -> Result<WindowFactor, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged, expecting = "expected 1, 2 or full")]
    enum Stored {
        Times(u8),
        Name(WindowFactor),
    }
    match Stored::deserialize(from)? {
        Stored::Times(1) => Ok(WindowFactor::One),
        Stored::Times(2) => Ok(WindowFactor::Two),
        Stored::Times(n) => Err(Error::custom(format!("{n} times the pupil: expected 1, 2 or full"))),
        Stored::Name(name) => Ok(name),
    }
}
