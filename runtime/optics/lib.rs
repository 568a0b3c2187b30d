//! Defines display, pupil, propagation and window as pure functions in float64, without buffers or threads.
//!
//! A phase-only SLM of `height` x `width` pixels, lit by a plane wave, shows `u = exp(i phi)`. A 4f relay puts its
//! Fourier plane at the eye's pupil. Frequency `q` arrives at the pupil position `wavelength * focal_length * q`.
//! Alternatively the SLM is in the pupil plane itself ([`Geometry::FarField`]).

mod color;
mod device;
mod dispersion;
mod display;
mod encoding;
mod eyebox;
mod fewer_modes;
mod focus;
mod geometry;
mod joint_color;
mod level_order;
mod light;
mod limits;
pub mod linear;
mod mask;
mod mask_design;
mod masked;
mod model;
mod model_tables;
mod obstruction;
mod padding;
mod phase;
mod picture;
mod prescription;
mod presets;
mod propagation;
mod pupil;
mod pupil_distribution;
mod quadrature;
mod reach;
mod source;
mod source_choice;
mod switched;
mod switching;
mod triggers;
mod two_eyes;
mod units;
mod viewing;
mod wavefront_map;
mod window;
mod zernike;

pub use color::Color;
pub use device::{Device, DeviceKind, PlaneTrigger, VideoLink};
pub use display::{Display, Wavelength};
pub use encoding::{
    ActiveArea, Channel, ChannelOrder, Correction, Encoding, Flip, Grating, Orientation, Packing, Place, TwoPi,
};
pub use eyebox::EyeboxRegion;
pub use fewer_modes::{FewerModes, fewer_modes};
pub use focus::{Depth, depth_in_words, depth_of_dioptres, depths_in_words, dioptres, dioptres_in_words};
pub use geometry::{Geometry, Optics, frequency_bin};
pub use joint_color::{JointColor, Laser, drive_of, drives_into, drives_of, phase_of};
pub use joint_color::{powers_in_sequence, reference_of, with_mean_of_one};
pub use level_order::LevelOrder;
pub use light::SourceSampling;
pub use limits::{
    check_usual_aperture, check_usual_depth, check_usual_depths, check_usual_diameters, check_usual_view_pitch,
};
pub use mask::{Mask, MaskPhases};
pub use model::{DisplayModel, Iris, Level, ModelOf, ModelSections, ModelTerms, Spread, WAVES};
pub use model_tables::SlmPart;
pub use obstruction::Obstruction;
pub use padding::{Padding, slow_sides, walk_off};
pub use phase::{level_of_phase, phase_of_level, wrap_phase};
pub use picture::{Picture, PictureMap, PictureWarp};
pub use prescription::Prescription;
pub use presets::{PRESETS, display_template, preset_about, preset_text};
pub use propagation::{aperture, transfer, transfer_of_bin};
pub use pupil::Pupil;
pub use pupil_distribution::PupilDistribution;
pub use reach::{Reach, SourcesReach, WithoutMask};
pub use source::{GivenMode, SourceKind, SourceMode, SourceSections, SourceShape, SourceTerms};
pub use source_choice::SourceChoice;
pub use switched::{Sources, SourcesLit, SwitchedSource};
pub use switching::{USUAL_RATE_HZ, mean_light};
pub use triggers::{Edge, Signal, TriggerIn, TriggerOn, TriggerOut, TriggerPort};
pub use two_eyes::{Panels, Stereo, TwoEyes};
pub use viewing::Viewing;
pub use window::{Window, WindowFactor, fast_size};
pub use zernike::{zernike, zernike_name};

use eyebox_base::error::Reason;

/// For `skip_serializing_if`, because files hold only values that differ from the default.
fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// An error of a display, a pupil or a grid.
#[derive(Debug, Clone, PartialEq, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
#[allow(missing_docs, reason = "fields that their names explain")]
pub enum OpticsError {
    /// A number must be positive and finite, but is not.
    #[error("{what} is {value}: it must be a positive, finite number{hint}")]
    NotPositive {
        /// The quantity with its unit.
        what: &'static str,
        /// The value in that unit.
        value: f64,
        /// A hint at the correct value, or an empty text.
        hint: &'static str,
    },
    /// A length is outside the range of real displays, in which float64 is accurate enough.
    #[error("{what} is {value:e}: it must be {low:e} to {high:e}{hint}")]
    OutOfRange {
        /// The quantity with its unit.
        what: &'static str,
        /// The value in that unit.
        value: f64,
        low: f64,
        high: f64,
        /// The value that is probably meant, or an empty text.
        hint: String,
    },
    /// A value is possible, but most likely a mistake.
    #[error("{given}: {probably}")]
    Unusual {
        /// The given value with its unit.
        given: String,
        /// The value that is probably meant.
        probably: String,
    },
    /// A number must be finite, but is not.
    #[error("{what} is {value}: it must be a finite number")]
    NotFinite {
        /// The quantity with its unit.
        what: &'static str,
        value: f64,
    },
    /// A resolution has an axis of zero pixels, or of more than 65536.
    #[error("the size {height}x{width} has no pixels or too many: each axis must be 1 to 65536")]
    Size { height: usize, width: usize },
    /// The pupil receives no light at all.
    #[error(
        "the pupil at ({x_mm}, {y_mm}) mm, {diameter_mm} mm wide, lies outside the {color} eyebox of {eyebox_mm:.2} mm: \
         its center must be within {reach_mm:.2} mm on each axis"
    )]
    OutsideEyebox {
        x_mm: f64,
        y_mm: f64,
        diameter_mm: f64,
        /// Side of the eyebox in mm.
        eyebox_mm: f64,
        /// Largest allowed coordinate of the center in mm.
        reach_mm: f64,
        /// The wavelength as text.
        color: String,
    },
    /// The name is neither a preset nor a readable file.
    #[error("the display '{name}' is neither a preset ({presets}) nor a readable file: {reason}")]
    UnknownDisplay {
        /// The name that was requested.
        name: String,
        presets: String,
        /// The reason why it could not be read.
        reason: Reason,
    },
    /// A display file is incomplete or wrong.
    #[error("display file {file}: {reason}")]
    DisplayFile {
        file: String,
        /// The fault in the file and its place.
        reason: Reason,
    },
    /// A prescription is impossible.
    #[error("the prescription: {reason}")]
    Prescription {
        /// The fault and its place.
        reason: Reason,
    },
    /// No obstruction has this name.
    #[error("the obstruction '{name}' is unknown: expected {known}")]
    UnknownObstruction { name: String, known: String },
    /// The viewing conditions are impossible.
    #[error("the viewing: {reason}")]
    Viewing {
        /// The fault of the viewing conditions.
        reason: Reason,
    },
    /// The eye blurs too much for the picture.
    #[error(
        "an eye of {eye} blurs a point over {blur_mm:.2} mm through a pupil of {diameter_mm:.2} mm, more than half of \
         the picture, {most_mm:.2} mm. This display serves that eye through pupils of up to {fits_mm:.2} mm"
    )]
    Blur {
        /// The eye in words.
        eye: String,
        diameter_mm: f64,
        /// Diameter of the blurred point in mm.
        blur_mm: f64,
        /// Largest allowed diameter of a blurred point in mm.
        most_mm: f64,
        /// Diameter in mm of the widest pupil that fits.
        fits_mm: f64,
    },
    /// The display does not have this color.
    #[error("the display '{display}' has no {color} wavelength: it has {has}")]
    NoColor { display: String, color: Color, has: String },
}
