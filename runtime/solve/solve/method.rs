//! The methods that can be compared (OPTICS 7).
//!
//! Each method chooses the viewpoints, the first phases and the loss terms besides the image. Operators, optimizers and
//! engines are the same for all.

use serde::{Deserialize, Serialize};

/// The method that makes a hologram.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Method {
    /// Random pupils (Schiffers et al. 2023).
    #[default]
    Slfh,
    /// A focal stack of the light field through the whole eyebox.
    Lf2fs,
    /// The short-time Fourier transform, compared with the views inside a circular Fourier filter (Choi et al. 2022).
    Stft,
    /// The short-time Fourier transform without the filter.
    StftUnfiltered,
    /// The short-time Fourier transform with an exact window. Each view has its disc in the pupil plane of both the
    /// wave and the light field.
    StftExact,
    /// A focal stack from constant phase by gradient descent. It always uses Adam because the projection keeps most of
    /// the symmetry of a constant phase.
    Smooth,
    /// The double-phase method, in closed form (Maimone et al. 2017).
    Dpac,
    /// A focal stack with the light evened out over the eyebox (Chakravarthula et al. 2022).
    PupilAware,
    /// The first phases of [`Slfh`](Self::Slfh) from a table, without a step ([`StartTable`](super::StartTable)).
    Table,
}

impl Method {
    /// All methods, the runtime's own first.
    pub const ALL: [Self; 9] = [
        Self::Slfh,
        Self::Lf2fs,
        Self::Stft,
        Self::StftUnfiltered,
        Self::StftExact,
        Self::Smooth,
        Self::Dpac,
        Self::PupilAware,
        Self::Table,
    ];

    /// Returns the name by which the method is chosen.
    pub fn name(self) -> &'static str {
        ["slfh", "lf2fs", "stft", "stft-unfiltered", "stft-exact", "smooth", "dpac", "pupil-aware", "table"]
            [self as usize]
    }

    /// Returns the method of this name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|m| m.name() == name)
    }

    /// Returns the title for people.
    pub fn title(self) -> &'static str {
        [
            "SLFH",
            "LF2FS",
            "STFT",
            "STFT, no filter",
            "STFT, exact window",
            "Smooth phase",
            "Double phase",
            "Pupil-aware",
            "Table",
        ][self as usize]
    }

    /// Returns a description of one sentence.
    pub fn about(self) -> &'static str {
        match self {
            Self::Slfh => "Random pupils anywhere in the eyebox, each with a target image of the light field.",
            Self::Lf2fs => "Target images of the light field through the whole eyebox, at random focus.",
            Self::Stft => {
                "The short-time Fourier transform (Hann window) of the wave against the views, inside a circle."
            }
            Self::StftUnfiltered => "The short-time Fourier transform against the views, with no circular filter.",
            Self::StftExact => "The disc of each view in the pupil plane of both the wave and the light field.",
            Self::Smooth => "Target images through the whole eyebox at random focus, from constant phase.",
            Self::Dpac => "The central view with its depth in closed form, with each complex value as two phases.",
            Self::PupilAware => "Target images through the whole eyebox, with the light evened out over the eyebox.",
            Self::Table => {
                "Phases from a table of the display for the brightness of each pixel, without a step, for pupils \
                 anywhere in the eyebox."
            }
        }
    }

    /// Returns the citation of the paper.
    pub fn citation(self) -> &'static str {
        match self {
            Self::Slfh => {
                "Schiffers, Chakravarthula, Matsuda, Kuo, Tseng, Lanman, Heide, Cossairt: Stochastic Light Field Holography, ICCP 2023"
            }
            Self::Lf2fs => {
                "Focal stacks of a light field, as compared in Schiffers et al., Stochastic Light Field Holography, ICCP 2023"
            }
            Self::Stft | Self::StftUnfiltered => {
                "Choi, Gopakumar, Peng, Kim, O'Toole, Wetzstein: Time-multiplexed Neural Holography, SIGGRAPH 2022"
            }
            Self::StftExact => {
                "The exact window that Schiffers et al., Stochastic Light Field Holography, ICCP 2023, argue for"
            }
            Self::Smooth => {
                "Gradient descent from constant phase. Compare Maimone, Georgiou, Kollin: Holographic Near-eye Displays, SIGGRAPH 2017"
            }
            Self::Dpac => {
                "Maimone, Georgiou, Kollin: Holographic Near-eye Displays for Virtual and Augmented Reality, SIGGRAPH 2017"
            }
            Self::Table => {
                "For one plane and brightness: Velez-Zea, Barrera-Ramirez, Torroba: Optimized random phase only holograms, Optics Letters 2018"
            }
            Self::PupilAware => {
                "Chakravarthula, Baek, Schiffers, Tseng, Kuo, Maimone, Matsuda, Cossairt, Lanman, Heide: Pupil-aware Holography, SIGGRAPH Asia 2022"
            }
        }
    }

    /// Returns true if the method takes steps. The other methods have their phases at once.
    pub fn is_iterative(self) -> bool {
        !matches!(self, Self::Dpac | Self::Table)
    }

    /// Returns true if the method simulates pupils, for light of any kind. Such light comes from a source of several
    /// modes, through a mask, or through the optics of a prescription.
    pub(super) fn looks_through_pupils(self) -> bool {
        !matches!(self, Self::Stft | Self::StftUnfiltered | Self::Dpac)
    }

    /// Returns true if all sub-frames are equal, so that one is enough to compute.
    pub(super) fn repeats_frames(self) -> bool {
        self == Self::Smooth
    }

    /// Returns true if the viewpoints are windows of the short-time Fourier transform.
    pub(super) fn is_stft(self) -> bool {
        matches!(self, Self::Stft | Self::StftUnfiltered)
    }
}
