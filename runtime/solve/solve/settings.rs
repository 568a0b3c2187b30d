//! The settings of a solve, shared by the library, the command, measured settings and a hologram's file.

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

/// The rule for padding the SLM.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum PaddingRule {
    /// Never. The edges then receive a little light that leaves the picture at the opposite side.
    #[default]
    Never,
    /// Pads if the light that leaves the picture would cost more than 0.05 dB.
    Need,
    /// Always pads, as wide as light moves out of the picture.
    Always,
    /// Never. A side that [transforms slowly](crate::optics::Padding::smooth) also stays as it is.
    Exact,
}

/// The phases with which a solve begins, if no phases are given.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum FirstPhases {
    /// Phases from a table for the picture ([`StartTable`](super::StartTable)), if the display has one.
    #[default]
    Table,
    /// Random phases, as in the paper.
    Random,
}

/// The settings of simultaneous color, in which all colors share their sub-frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Joint {
    /// Factor by which white is brighter than with one color after another, at the same peak power of the lasers.
    ///
    /// It is 1 to the number of colors. Each power is then at most the number of colors over this factor, times their
    /// mean. The largest factor makes all powers equal.
    pub brightness: f64,
}

impl Default for Joint {
    fn default() -> Self {
        Self { brightness: 1.0 }
    }
}

/// Largest length of an eye or a scene, in meters. It keeps all computed values finite.
const FARTHEST: f64 = 1e3;
/// Least momentum if colors share their drive values. The changes that the colors request differ and average out over
/// several steps. It gains 0.4 dB of the mean and 1 dB of the worst pupil over a half (measured on an SLM of two
/// turns).
const JOINT_MOMENTUM: f64 = 0.7;

/// Everything that decides a solve, besides the scene and the display.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Settings {
    /// Number of shown sub-frames, which are optimized jointly on their mean intensity.
    pub frames: usize,
    /// Number of times that each solved sub-frame is shown. At 2, half of the sub-frames are solved. A value that does
    /// not divide `frames` counts as the greatest common divisor of both.
    #[serde(skip_serializing_if = "is_one")]
    pub repeats: usize,
    /// The method, which decides the viewpoints and the first phases.
    pub method: Method,
    /// The first phases, if none are given. The default is a table's phases, if the display has one.
    #[serde(skip_serializing_if = "is_default")]
    pub first_phases: FirstPhases,
    /// The optimizer. A file may contain its name alone.
    #[serde(deserialize_with = "optimizer")]
    pub optimizer: Optimizer,
    /// Largest number of steps.
    pub steps: usize,
    /// Number of pupils per step.
    pub pupils: usize,
    /// Largest number of seconds. The schedule follows steps or seconds, whichever ends first.
    pub seconds: Option<f64>,
    /// Mean PSNR of the validation pupils at which the solve stops, in dB.
    pub psnr: Option<f64>,
    /// Share of the light that the pupils receive, as the mean of the target over the exposure. `None` derives it from
    /// the scene.
    pub efficiency: Option<f64>,
    /// Spectral window of each pupil. Files may also contain 1 or 2.
    #[serde(deserialize_with = "window")]
    pub window: WindowFactor,
    /// Range of drawn diameters, in meters.
    pub diameter: [f64; 2],
    /// Range of drawn focus depths, in meters.
    pub depth: [f64; 2],
    /// Distribution of the diameters.
    pub diameters: Diameters,
    /// Sequence of the pupils.
    pub sequence: Sequence,
    /// Seed of the first phases and the pupils.
    pub seed: u64,
    /// Diameter of the STFT's circular Fourier filter over the side of the eyebox ([`Method::Stft`], Choi et al. 2022).
    pub stft_filter: f64,
    /// Pixels of the STFT's window along each axis. `None` is the number of views.
    pub stft_samples: Option<usize>,
    /// Weight of the evenness of the light over the eyebox ([`Method::PupilAware`]). For the projection it is the share
    /// of the way to an even eyebox that a step requests. For Adam it is the factor of the term in the loss.
    pub evenness: f64,
    /// Number of patches of the eyebox along each axis, 1 to 16, whose light is evened out.
    pub patches: usize,
    /// Phases that the SLM can show.
    pub levels: Levels,
    /// Rule for padding the SLM with zeros. It decides how a [`Problem`](super::Problem) is made by
    /// [`ScenePlan`](super::ScenePlan) and [`quality::ColorJob`](crate::quality::ColorJob).
    #[serde(deserialize_with = "padding", skip_serializing_if = "is_default")]
    pub padding: PaddingRule,
    /// Step between used views of the light field along both axes. A [`quality::ColorJob`](crate::quality::ColorJob)
    /// removes the others.
    #[serde(skip_serializing_if = "is_one")]
    pub views: usize,
    /// Side of a solved pixel in pixels of the SLM, 1 or 2. At 2 a [`quality::ColorJob`](crate::quality::ColorJob)
    /// solves a display of half the resolution and twice the pitch, and shows each of its pixels on 2 x 2.
    #[serde(skip_serializing_if = "is_one")]
    pub pixel: usize,
    /// True if every pupil receives all modes of the source. Otherwise wide pupils receive fewer modes, if their
    /// speckle stays the same.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub all_modes: bool,
    /// Movement while the sub-frames are lit, which the pupils include ([`Method::Slfh`] and the methods of focal
    /// stacks).
    #[serde(skip_serializing_if = "Motion::is_still")]
    pub motion: Motion,
    /// Settings of simultaneous color with shared sub-frames, or `None` for one color after another. It applies to
    /// solves of all colors of a scene ([`solve_joint`](super::solve_joint)).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joint: Option<Joint>,
    /// Largest memory of the windows of pupils in flight, in bytes as float32. Halves need half of it. In a device's
    /// own memory the limit is double, for values as they are stored there.
    pub window_bytes: usize,
    /// Storage of complex fields during the solve. Halves need half the memory and lose some quality
    /// (docs/measurements.md).
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
    /// Returns the number of values of the windows of pupils in flight, on an engine whose buffers are in `memory`.
    ///
    /// More pupils at once need fewer stages on a device. They bring nothing on the host.
    pub(crate) fn in_flight(&self, memory: Memory) -> usize {
        match memory {
            Memory::Device => 2 * self.window_bytes / self.storage.bytes(),
            Memory::Host | Memory::Shared => self.window_bytes / size_of::<Complex32>(),
        }
    }

    /// Returns the range of pupils in an eyebox of this side, in meters.
    pub(crate) fn pupil_range(&self, eyebox: f64) -> PupilRange {
        PupilRange { eyebox, diameter: self.diameter, depth: self.depth, diameters: self.diameters }
    }

    /// Returns the steps of the projection that move light as far as these steps do.
    pub(super) fn steps_of_projection(&self) -> usize {
        /// Steps of Adam that have the effect of one step of the projection (docs/results/display-model.json).
        const ADAM: usize = 10;
        if matches!(self.optimizer, Optimizer::Adam { .. }) { self.steps / ADAM } else { self.steps }
    }

    /// Returns the number of solved sub-frames. Groups of `repeats` sub-frames are equal if that number divides them.
    pub fn solved_frames(&self) -> usize {
        fn common_divisor(a: usize, b: usize) -> usize {
            if b == 0 { a } else { common_divisor(b, a % b) }
        }
        self.frames / common_divisor(self.frames.max(1), self.repeats.max(1))
    }

    /// Returns these settings with the solved sub-frames and the optimizer that the method requires.
    pub(super) fn as_computed(&self) -> Self {
        let frames = if self.method.repeats_frames() { 1 } else { self.solved_frames() };
        let optimizer = match (self.method, self.optimizer) {
            (Method::Smooth, Optimizer::Projection { .. }) => Optimizer::adam(),
            (_, optimizer) => optimizer,
        };
        Self { frames, repeats: 1, optimizer, ..self.clone() }
    }

    /// Returns these settings with all fields of `other` that trade quality for time.
    ///
    /// Depths, diameters, seed, shown sub-frames, given levels and method stay, since they belong to the scene and the
    /// display.
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

    /// Returns these settings for simultaneous color, with all pixels, views and sub-frames, in float32.
    pub fn for_joint_colors(&self) -> Self {
        let optimizer = match self.optimizer {
            Optimizer::Projection { gain, momentum, overlap_power } => {
                Optimizer::Projection { gain, momentum: momentum.max(JOINT_MOMENTUM), overlap_power }
            }
            other => other,
        };
        Self { repeats: 1, pixel: 1, views: 1, storage: Storage::F32, optimizer, ..self.clone() }
    }

    /// Returns an error for settings that simultaneous color does not support.
    fn check_joint(&self) -> Result<(), SolveError> {
        let Some(Joint { brightness }) = self.joint else { return Ok(()) };
        let is_bright = brightness >= 1.0 && brightness.is_finite();
        require(is_bright, "the brightness of joint colors", brightness, "1 to the number of colors")?;
        let is_joint = matches!(self.method, Method::Slfh | Method::Lf2fs | Method::StftExact);
        let right = "slfh, lf2fs or stft-exact for simultaneous color";
        require(is_joint, "the method", self.method.name(), right)?;
        let right = "any phase for simultaneous color";
        require(self.levels == Levels::Any, "the choice of phase levels", "given", right)?;
        require(self.motion.is_still(), "the motion", "given", "none for simultaneous color")
    }

    /// Checks every setting and the limits of each.
    ///
    /// # Errors
    /// [`SolveError::Setting`] for the first invalid setting.
    pub fn check(&self) -> Result<(), SolveError> {
        let mm = |[a, b]: [f64; 2]| format!("{}..{}", a * 1e3, b * 1e3);
        let ([low, high], [near, far]) = (self.diameter, self.depth);
        require((1..=4096).contains(&self.frames), "the number of sub-frames", self.frames, "1 to 4096")?;
        require((1..=65536).contains(&self.pupils), "the number of pupils per step", self.pupils, "1 to 65536")?;
        let (what, right) = ("the range of pupil diameters (mm)", "positive, smallest first, at most 1e6");
        require(low > 0.0 && low <= high && high <= FARTHEST, what, mm(self.diameter), right)?;
        let (what, right) = ("the range of depths (mm)", "within 1e6, smallest first");
        require(near <= far && -FARTHEST <= near && far <= FARTHEST, what, mm(self.depth), right)?;
        let (filter, right) = (self.stft_filter, "above 0, at most 2 times the eyebox");
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

// Defaults are omitted. Files thus equal those from earlier versions and can be continued.
fn is_one(n: &usize) -> bool {
    *n == 1
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// Reads a rule, or the switch that earlier versions wrote.
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

/// Reads an optimizer or its name alone.
fn optimizer<'de, D: Deserializer<'de>>(from: D) -> Result<Optimizer, D::Error> {
    whole_or_name(from, Optimizer::projection(), Optimizer::adam())
}

/// Reads a whole value, or one of two values by its name alone.
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

/// Reads a window by its name, or as a multiple of the pupil.
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
