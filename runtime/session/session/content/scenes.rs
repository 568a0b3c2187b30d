//! What is to be seen, where that changes while it is shown.

use crate::optics::PupilDistribution;
use crate::scene::ViewsOnDevice;
use crate::session::frame_log::error::SessionError;
use crate::session::refinement::field::LiveColor;
use crate::tiled::TileRect;
use std::sync::Arc;

/// A scene that is to be seen from some time on.
#[derive(Clone)]
pub struct SceneFrame {
    /// Its number: larger than that of any before.
    pub number: u64,
    /// The scene before every color, in the order of the refined colors. Phases are its own hologram for the whole eyebox,
    /// or empty. Shared, because a scene at 1080p has 199 MB of them.
    pub colors: Arc<Vec<LiveColor>>,
    /// When it came, nanoseconds on the player's clock; none where it was there all along.
    pub arrived_ns: Option<i64>,
    /// The moment of the content that it shows, on the same clock; none where it stands still, or nobody says.
    pub shows_ns: Option<i64>,
    /// Of a far field, the piece of it that this is; its phases are those of the piece as they were solved.
    pub piece: Option<TileRect>,
}

impl SceneFrame {
    /// A scene that was there all along and stands still.
    pub(crate) fn new(number: u64, colors: Arc<Vec<LiveColor>>) -> Self {
        Self { number, colors, arrived_ns: None, shows_ns: None, piece: None }
    }

    /// Whether its views were in the memory of a device that is lost.
    pub(crate) fn is_lost(&self) -> bool {
        self.colors.iter().any(|c| c.problem.pyramid.on_device().is_some_and(ViewsOnDevice::is_lost))
    }
}

/// The set that a scene is wanted for.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct Due {
    /// When it is asked, nanoseconds on the player's clock.
    pub now_ns: i64,
    /// The middle of the set's light, on the same clock.
    pub light_ns: i64,
    /// The same on the system's monotonic clock.
    pub light_monotonic_ns: u64,
    /// From one set to the next, nanoseconds.
    pub period_ns: i64,
    /// Where the pupil will be then.
    pub pupil: PupilDistribution,
    /// How fast it moves (x, y), metres a second.
    pub velocity: [f64; 2],
    /// Whether a tracker says so.
    pub tracked: bool,
    /// Whether time waits: what is due is waited for.
    pub patient: bool,
}

/// What there is to be seen.
#[non_exhaustive]
pub enum Newest {
    /// Another scene.
    New(SceneFrame),
    /// The same as before, and that is as it should be.
    Same,
    /// The same as before, though another should be there.
    Late(FrameFreshness),
    /// There was another, and it is left out for this reason.
    Refused(String),
    /// Nothing more.
    Ended,
}

/// Scenes that follow each other. They are asked on the thread that refines, between steps, and wait for nobody.
pub trait Scenes: Send {
    /// What it is, for people.
    fn describe(&self) -> String;

    /// What is to be seen by the light of this set.
    ///
    /// # Errors
    /// What ends the session's refinement: [`Newest::Refused`] is for what leaves out one scene.
    fn next(&mut self, due: &Due) -> Result<Newest, SessionError>;

    /// Whether it brings the first scene along; else the idle picture is shown until one comes.
    fn begins_with_one(&self) -> bool {
        true
    }
}

/// How the content of a set came.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum FrameFreshness {
    /// It is new.
    New,
    /// It is that of the set before: nothing else was due.
    #[default]
    Same,
    /// It is that of the set before, for the next was not read in time.
    LateContent,
    /// It is that of the set before, for the application gave nothing new in time.
    ApplicationLate,
    /// It is that of the set before, for there is no application.
    ApplicationGone,
}

impl FrameFreshness {
    /// All of them, in the order of the account.
    pub const ALL: [Self; 5] = [Self::New, Self::Same, Self::LateContent, Self::ApplicationLate, Self::ApplicationGone];

    /// For people and statistics.
    pub fn name(self) -> &'static str {
        ["new", "same", "late content", "application late", "application gone"][self as usize]
    }
}
