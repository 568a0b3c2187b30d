//! Wraps every error of the library in one type.

use eyebox_base::files::FileError;
use eyebox_calibrate::CalibrateError;
use eyebox_compute::engine::EngineError;
use eyebox_optics::OpticsError;
#[cfg(feature = "window")]
use eyebox_present::PresentError;
use eyebox_scene::SceneError;
#[cfg(feature = "preview")]
use eyebox_session::preview::PreviewError;
#[cfg(feature = "window")]
use eyebox_session::session::SessionError;
use eyebox_solve::encode::EncodeError;
use eyebox_solve::evaluate::EvaluateError;
use eyebox_solve::hologram::HologramError;
use eyebox_solve::produce::ProduceError;
use eyebox_solve::quality::QualityError;
use eyebox_solve::reconstruction::ReconstructionError;
use eyebox_solve::solve::SolveError;
use eyebox_solve::tiled::TiledError;
use eyebox_tracking::gaze::GazeError;
use eyebox_tracking::trackers::TrackerError;

/// Any error of the library. Every error type of the library converts into it, so `?` works in functions that return
/// it.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[error(transparent)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
#[allow(missing_docs, reason = "each variant has the name of its type")]
pub enum Error {
    Calibrate(#[from] CalibrateError),
    Encode(#[from] EncodeError),
    Engine(#[from] EngineError),
    Evaluate(#[from] EvaluateError),
    File(#[from] FileError),
    Gaze(#[from] GazeError),
    Hologram(#[from] HologramError),
    Optics(#[from] OpticsError),
    #[cfg(feature = "window")]
    Present(#[from] PresentError),
    #[cfg(feature = "preview")]
    Preview(#[from] PreviewError),
    Produce(#[from] ProduceError),
    Quality(#[from] QualityError),
    Reconstruction(#[from] ReconstructionError),
    Scene(#[from] SceneError),
    #[cfg(feature = "window")]
    Session(#[from] SessionError),
    Solve(#[from] SolveError),
    Tiled(#[from] TiledError),
    Tracker(#[from] TrackerError),
}

/// The part of the library that an [`Error`] is about. C has a status for most of these kinds, and Python has an
/// exception.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ErrorKind {
    /// The display, or a pupil in front of it.
    Display,
    /// The scene, its file or its views.
    Scene,
    /// The settings, or the solve or refinement that they describe.
    Solve,
    /// The hologram, its file, or its scores.
    Hologram,
    /// The encoding, or the phases to encode.
    Encode,
    /// The calibration of a display, its camera or its pictures.
    Calibrate,
    /// A session, the screen that it shows on, or the eye tracker.
    Session,
    /// The engine or its device.
    Engine,
    /// A file that no other kind covers.
    File,
}

impl Error {
    /// Returns the part of the library that the error is about.
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Optics(_) | Self::Produce(ProduceError::Optics(_)) => ErrorKind::Display,
            Self::Scene(_) | Self::Produce(ProduceError::Scene(_)) => ErrorKind::Scene,
            Self::Engine(_)
            | Self::Reconstruction(ReconstructionError::Engine(_))
            | Self::Produce(ProduceError::Engine(_) | ProduceError::Reconstruction(ReconstructionError::Engine(_))) => {
                ErrorKind::Engine
            }
            Self::Solve(_) | Self::Produce(_) | Self::Quality(_) | Self::Tiled(_) => ErrorKind::Solve,
            Self::Hologram(error) | Self::Reconstruction(ReconstructionError::Hologram(error)) => of_hologram(error),
            Self::Evaluate(_) | Self::Reconstruction(_) => ErrorKind::Hologram,
            Self::Encode(_) => ErrorKind::Encode,
            Self::Calibrate(_) => ErrorKind::Calibrate,
            #[cfg(feature = "window")]
            Self::Session(error) => match error {
                SessionError::Hologram(error) => of_hologram(error),
                SessionError::Encode(_) => ErrorKind::Encode,
                SessionError::Engine(_) => ErrorKind::Engine,
                SessionError::Solve(_) => ErrorKind::Solve,
                _ => ErrorKind::Session,
            },
            #[cfg(feature = "window")]
            Self::Present(_) => ErrorKind::Session,
            #[cfg(feature = "preview")]
            Self::Preview(_) => ErrorKind::Session,
            Self::Gaze(_) | Self::Tracker(_) => ErrorKind::Session,
            Self::File(_) => ErrorKind::File,
        }
    }
}

/// Returns the kind of an error of a hologram, which may be about the display or the scene that the hologram names.
fn of_hologram(error: &HologramError) -> ErrorKind {
    match error {
        HologramError::Optics(_) | HologramError::NoDisplay | HologramError::DisplayNotFound { .. } => {
            ErrorKind::Display
        }
        HologramError::Scene(_)
        | HologramError::OtherScene { .. }
        | HologramError::ChangedScene { .. }
        | HologramError::SceneNotFound { .. }
        | HologramError::NoScene { .. }
        | HologramError::OtherSize { .. } => ErrorKind::Scene,
        _ => ErrorKind::Hologram,
    }
}

#[cfg(test)]
mod tests {
    use super::{ErrorKind::*, *};
    use eyebox_base::error::{ErrorData, Reason};

    #[test]
    fn errors_have_a_kind_and_the_code_of_the_innermost() {
        let optics = || OpticsError::Size { height: 0, width: 0 };
        let scene = || SceneError::Matrix { file: "a.y4m".into() };
        let engine = || EngineError::Stopped;
        let reason = |code: &'static str| Reason::new(code, "a sentence");
        let no_scene = || HologramError::NoScene { of_array: true };
        let cases: Vec<(Error, ErrorKind, &str)> = vec![
            (optics().into(), Display, "optics/size"),
            (scene().into(), Scene, "scene/matrix"),
            (engine().into(), Engine, "engine/stopped"),
            (SolveError::from(scene()).into(), Solve, "scene/matrix"),
            (QualityError::from(engine()).into(), Solve, "engine/stopped"),
            (TiledError::from(no_scene()).into(), Solve, "hologram/no-scene"),
            (ProduceError::from(optics()).into(), Display, "optics/size"),
            (ProduceError::from(scene()).into(), Scene, "scene/matrix"),
            (ProduceError::from(engine()).into(), Engine, "engine/stopped"),
            (ProduceError::from(ReconstructionError::from(engine())).into(), Engine, "engine/stopped"),
            (ProduceError::from(ReconstructionError::from(optics())).into(), Solve, "optics/size"),
            (ProduceError::from(no_scene()).into(), Solve, "hologram/no-scene"),
            (ProduceError::Job(reason("no-file")).into(), Solve, "produce/job/no-file"),
            (HologramError::NoExposure.into(), Hologram, "hologram/no-exposure"),
            (HologramError::NoDisplay.into(), Display, "hologram/no-display"),
            (HologramError::from(optics()).into(), Display, "optics/size"),
            (no_scene().into(), Scene, "hologram/no-scene"),
            (ReconstructionError::from(no_scene()).into(), Scene, "hologram/no-scene"),
            (ReconstructionError::from(engine()).into(), Engine, "engine/stopped"),
            (ReconstructionError::from(EvaluateError::Dark).into(), Hologram, "evaluate/dark"),
            (EvaluateError::Dark.into(), Hologram, "evaluate/dark"),
            (CalibrateError::Stopped.into(), Calibrate, "calibrate/stopped"),
            (GazeError::TooFew(String::new()).into(), Session, "gaze/too-few"),
            (TrackerError::Setting(reason("rate")).into(), Session, "tracker/setting/rate"),
            (FileError::Content { file: "a".into(), reason: reason("png") }.into(), File, "file/content/png"),
            #[cfg(feature = "window")]
            (PresentError::Rate { value: "0".into() }.into(), Session, "present/rate"),
            #[cfg(feature = "window")]
            (SessionError::from(no_scene()).into(), Scene, "hologram/no-scene"),
            #[cfg(feature = "window")]
            (SessionError::from(engine()).into(), Engine, "engine/stopped"),
            #[cfg(feature = "window")]
            (SessionError::from(SolveError::from(scene())).into(), Solve, "scene/matrix"),
            #[cfg(feature = "window")]
            (SessionError::from(CalibrateError::Stopped).into(), Session, "calibrate/stopped"),
        ];
        for (error, kind, code) in cases {
            assert_eq!((error.kind(), &*ErrorData::of(&error).code), (kind, code), "{error:?}");
        }
    }
}
