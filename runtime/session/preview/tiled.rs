//! What is seen of a far field in tiles: what is read and computed follows the pupil, and the hologram may be larger than
//! memory.

use super::PreviewError;
use super::picture::Detail;
use crate::engine::Engine;
use crate::evaluate::Plane;
use crate::hologram::{PhaseSource, Tiles};
use crate::optics::Pupil;
use std::sync::Arc;

/// Pixels of the SLM across the pupil of a coarse picture.
const ACROSS: f64 = 384.0;

/// Each colour through the pupil, as `eyebox view` has it. A coarse picture is what the middle of the pupil sees: fewer
/// tiles, fewer details, the same parallax and light.
pub(super) fn look(
    tiles: &Arc<Tiles>,
    frame: Option<usize>,
    pupil: &Pupil,
    detail: Detail,
    engine: &mut dyn Engine,
) -> Result<Vec<Plane>, PreviewError> {
    let pupil = match detail {
        Detail::Whole => *pupil,
        Detail::Coarse => Pupil { diameter: (ACROSS * tiles.about().pitch).min(pupil.diameter / 2.0), ..*pupil },
    };
    Ok(PhaseSource::Tiled(Arc::clone(tiles)).look(frame, &pupil, engine)?)
}
