//! Counts the video frames of two eyes that belong together.

use crate::optics::Stereo;
use crate::present::{Apart, Link};
use crate::session::feeds::statistics::LiveStatistics;
use crate::session::playback::controller::ControllerReport;
use serde_json::{Value, json};

/// The statistics of two eyes, and those of the right eye. The other statistics are those of the left eye.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct TwoEyesReport {
    /// The rule for the sets of the two eyes.
    pub stereo: Stereo,
    /// The video frames of content on both eyes.
    pub video_frames: u64,
    /// The video frames in which the eyes showed sets of different times or of different content.
    pub differing: u64,
    /// The distance in time between the lights of two panels, if there are two.
    pub apart: Option<Apart>,
    /// The link to the right panel at the beginning, if a display showed the session.
    pub right_link: Option<Link>,
    /// The statistics of the right panel's controller, if it has one.
    pub right_controller: Option<ControllerReport>,
    /// The statistics of the right eye, if content was refined.
    pub right_live: Option<LiveStatistics>,
}

impl TwoEyesReport {
    /// Returns the statistics for programs, with the keys of `docs/two-eyes.md`.
    pub(crate) fn to_json(&self) -> Value {
        let mut all = json!({
            "stereo": self.stereo, "video_frames": self.video_frames, "differing": self.differing,
        });
        if let Some(apart) = self.apart {
            all["light_apart"] = json!({
                "video_frames": apart.video_frames, "in_other_periods": apart.in_other_periods,
                "mean_ms": apart.mean_ms(), "largest_ms": apart.largest_ms(),
            });
        }
        if let Some(link) = &self.right_link {
            all["right_link"] = json!(link);
        }
        if let Some(controller) = &self.right_controller {
            all["right_controller"] = controller.to_json();
        }
        if let Some(live) = &self.right_live {
            all["right_eye"] = live.to_json();
        }
        all
    }
}
