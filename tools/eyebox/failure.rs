//! What can go wrong in a command: one line each.

use eyebox::calibrate::CalibrateError;
use eyebox::encode::EncodeError;
use eyebox::engine::EngineError;
use eyebox::evaluate::EvaluateError;
use eyebox::files::FileError;
use eyebox::film::FilmError;
use eyebox::gaze::GazeError;
use eyebox::hologram::HologramError;
use eyebox::optics::OpticsError;
use eyebox::present::PresentError;
use eyebox::preview::PreviewError;
use eyebox::produce::ProduceError;
use eyebox::quality::QualityError;
use eyebox::scene::SceneError;
use eyebox::session::SessionError;
use eyebox::solve::SolveError;
use eyebox::tiled::TiledError;
use eyebox::trackers::TrackerError;
use eyebox_live_input::LiveError;

/// Why a command failed.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// The display, the pupil or the grid.
    #[error(transparent)]
    Optics(#[from] OpticsError),
    /// The scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The engine.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// The solve.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// The hologram.
    #[error(transparent)]
    Hologram(#[from] HologramError),
    /// The encoding.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// The comparison.
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    /// A trial of settings.
    #[error(transparent)]
    Quality(#[from] QualityError),
    /// What a job was to make.
    #[error(transparent)]
    Produce(#[from] ProduceError),
    /// A file.
    #[error(transparent)]
    File(#[from] FileError),
    /// A film.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// A hologram larger than memory.
    #[error(transparent)]
    Tiled(#[from] TiledError),
    /// An eye tracker.
    #[error(transparent)]
    Tracker(#[from] TrackerError),
    /// A calibration, or a setting of the way from sample to pupil.
    #[error(transparent)]
    Gaze(#[from] GazeError),
    /// The calibration of a display.
    #[error(transparent)]
    Calibrate(#[from] CalibrateError),
    /// A session.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The display, or a window.
    #[error(transparent)]
    Present(#[from] PresentError),
    /// The preview.
    #[error(transparent)]
    Preview(#[from] PreviewError),
    /// A display that takes frames.
    #[error(transparent)]
    Live(#[from] LiveError),
    /// The display was lost while it was played to.
    #[error("{0}")]
    Lost(String),
    /// What was asked for does not fit together.
    #[error("{0}")]
    Asked(String),
}

impl Failure {
    /// The exit code.
    pub fn code(&self) -> u8 {
        let ended = matches!(self, Self::Calibrate(e) if e.is_ended());
        if ended || matches!(self, Self::Lost(_)) { 3 } else { 2 }
    }
}

/// A sentence of the library in the words of the command: its fields are options here.
pub fn in_options(sentence: &str) -> String {
    [
        ("`depth`", "--depth MIN..MAX"),
        ("`depth_map`", "--depth-map FILE"),
        ("`near`", "--near"),
        ("`order`", "--order"),
        ("`photographs`", "--photographs"),
    ]
    .into_iter()
    .fold(sentence.to_owned(), |text, (field, option)| text.replace(field, option))
}
