//! The methods that can be compared: each is a choice of what is looked through, of the first phases and of terms beside
//! the image; operators, optimisers and engines are the same for all (OPTICS 7).

use serde::{Deserialize, Serialize};

/// How a hologram is made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Method {
    /// Random pupils (Schiffers et al. 2023).
    #[default]
    Slfh,
    /// A focal stack of the light field through the whole eyebox.
    Lf2fs,
    /// The short-time Fourier transform against the views, inside a circular Fourier filter (Choi et al. 2022).
    Stft,
    /// The same without the filter.
    StftUnfiltered,
    /// The same with an exact window: each view's disc in the pupil plane, on the wave as on the light field.
    StftExact,
    /// A focal stack, from constant phase, by gradient descent: Adam, whatever optimiser is set, for the projection
    /// keeps most of a constant phase's symmetry.
    Smooth,
    /// The double-phase method, in closed form (Maimone et al. 2017).
    Dpac,
    /// A focal stack, and light evened out over the eyebox (Chakravarthula et al. 2022).
    PupilAware,
    /// The first phases of [`Slfh`](Self::Slfh), from a table, and no step ([`StartTable`](super::StartTable)).
    Table,
}

impl Method {
    /// All of them, the runtime's own first.
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

    /// The name by which it is chosen.
    pub fn name(self) -> &'static str {
        ["slfh", "lf2fs", "stft", "stft-unfiltered", "stft-exact", "smooth", "dpac", "pupil-aware", "table"]
            [self as usize]
    }

    /// The method of this name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|m| m.name() == name)
    }

    /// For people.
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

    /// What it does, in one sentence.
    pub fn about(self) -> &'static str {
        match self {
            Self::Slfh => "Random pupils anywhere in the eyebox: each photograph of the light field against its image.",
            Self::Lf2fs => "Photographs of the light field through the whole eyebox, at random focus.",
            Self::Stft => {
                "The wave's short-time Fourier transform (Hann window) against the views, inside a circular filter."
            }
            Self::StftUnfiltered => "The short-time Fourier transform against the views, with no circular filter.",
            Self::StftExact => "Each view's own disc of the pupil plane, on the wave as on the light field.",
            Self::Smooth => "Photographs through the whole eyebox at random focus, from constant phase.",
            Self::Dpac => "The central view with its depth, each complex value written as two phases; closed form.",
            Self::PupilAware => "Photographs through the whole eyebox, and light evened out over the eyebox.",
            Self::Table => {
                "Phases that a table of the display has for each pixel's brightness: no step, for pupils anywhere in the eyebox."
            }
        }
    }

    /// The paper.
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
                "Gradient descent from constant phase; compare Maimone, Georgiou, Kollin: Holographic Near-eye Displays, SIGGRAPH 2017"
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

    /// Whether it takes steps; the others have their phases at once.
    pub fn is_iterative(self) -> bool {
        !matches!(self, Self::Dpac | Self::Table)
    }

    /// Whether what it solves for are pupils, whatever light fills them: of a source of several modes, through a mask, behind a
    /// prescription.
    pub(super) fn looks_through_pupils(self) -> bool {
        !matches!(self, Self::Stft | Self::StftUnfiltered | Self::Dpac)
    }

    /// Whether all sub-frames come out alike, so that one is enough to compute.
    pub(super) fn repeats_frames(self) -> bool {
        self == Self::Smooth
    }

    /// Whether it looks through windows of the short-time Fourier transform.
    pub(super) fn is_stft(self) -> bool {
        matches!(self, Self::Stft | Self::StftUnfiltered)
    }
}
