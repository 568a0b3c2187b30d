//! Defines scenes that change while they are shown.

use crate::optics::PupilDistribution;
use crate::scene::ViewsOnDevice;
use crate::session::frame_log::error::SessionError;
use crate::session::refinement::field::LiveColor;
use crate::tiled::TileRect;
use std::sync::Arc;

/// A scene that is shown from some time on.
#[derive(Clone)]
pub struct SceneFrame {
    /// The number of the scene, larger than the numbers of all earlier scenes.
    pub number: u64,
    /// The scene before every color, in the order of the refined colors. The phases are a hologram of the scene for the
    /// whole eyebox, or are empty. The colors are shared because a scene at 1080p has 199 MB of them.
    pub colors: Arc<Vec<LiveColor>>,
    /// The time of arrival (ns on the clock of the player), or `None` if the scene was there from the start.
    pub arrived_ns: Option<i64>,
    /// The time of the content that it shows, on the same clock. It is `None` if the content is still or its time is
    /// unknown.
    pub shows_ns: Option<i64>,
    /// The moment of the content, in any unit that the sources of both eyes share. Sets of two eyes that show together
    /// have the same moment. `None` belongs to every moment.
    pub moment: Option<i64>,
    /// The piece of a far field that this scene is. Its phases are the solved phases of the piece.
    pub piece: Option<TileRect>,
}

impl SceneFrame {
    /// Creates a still scene that was there from the start. Its number is its moment.
    pub(crate) fn new(number: u64, colors: Arc<Vec<LiveColor>>) -> Self {
        let moment = i64::try_from(number).ok();
        Self { number, colors, arrived_ns: None, shows_ns: None, moment, piece: None }
    }

    /// Returns true if its views were in the memory of a device that is lost.
    pub(crate) fn is_lost(&self) -> bool {
        self.colors.iter().any(|c| c.problem.pyramid.on_device().is_some_and(ViewsOnDevice::is_lost))
    }
}

/// The multiplex set for which a scene is requested.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct Due {
    /// The time of the request (ns on the clock of the player).
    pub now_ns: i64,
    /// The middle of the light of the set (ns on the same clock).
    pub light_ns: i64,
    /// The same time on the monotonic clock of the system (ns).
    pub light_monotonic_ns: u64,
    /// The time from one set to the next (ns).
    pub period_ns: i64,
    /// The predicted pupil at that time.
    pub pupil: PupilDistribution,
    /// The velocity of the pupil (x, y) in m/s.
    pub velocity: [f64; 2],
    /// True if a tracker supplied the prediction.
    pub tracked: bool,
    /// True in simulated time, in which scenes may wait for the content that is due.
    pub patient: bool,
}

/// The result of a request for a scene.
#[non_exhaustive]
pub enum Newest {
    /// A new scene is to be shown.
    New(SceneFrame),
    /// The scene is the same as before, as intended.
    Same,
    /// The scene is the same as before, although another one is due.
    Late(FrameFreshness),
    /// Another scene arrived but is skipped for this reason.
    Refused(String),
    /// The content has ended.
    Ended,
}

/// A source of successive scenes. The refinement thread requests them between steps, so a request must not wait.
pub trait Scenes: Send {
    /// Describes the source for people.
    fn describe(&self) -> String;

    /// Returns the scene for the light of this set.
    ///
    /// # Errors
    /// Returns the error that ends the refinement of the session. [`Newest::Refused`] only skips one scene.
    fn next(&mut self, due: &Due) -> Result<Newest, SessionError>;

    /// Returns true if the source supplies the first scene at the start. Otherwise the idle picture is shown until a
    /// scene arrives.
    fn begins_with_one(&self) -> bool {
        true
    }
}

/// The freshness of the content of a set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum FrameFreshness {
    /// The content is new.
    New,
    /// The content is the same as in the previous set, because nothing else was due.
    #[default]
    Same,
    /// The content is the same as in the previous set, because the next one was not read in time.
    LateContent,
    /// The content is the same as in the previous set, because the application sent nothing new in time.
    ApplicationLate,
    /// The content is the same as in the previous set, because no application is connected.
    ApplicationGone,
}

impl FrameFreshness {
    /// All values in the order of the statistics.
    pub const ALL: [Self; 5] = [Self::New, Self::Same, Self::LateContent, Self::ApplicationLate, Self::ApplicationGone];

    /// Returns the name for people and statistics.
    pub fn name(self) -> &'static str {
        ["new", "same", "late content", "application late", "application gone"][self as usize]
    }
}
