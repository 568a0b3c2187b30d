//! Moves one camera for the splats of one eye or of two eyes.

use crate::scene::SplatCamera;
use std::sync::{Arc, Mutex, PoisonError};

/// An eye does not wait longer than this for the other one (ns).
const PATIENCE_NS: i64 = 500_000_000;

/// A camera at a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shot {
    pub camera: SplatCamera,
    /// The number of the moment.
    pub moment: i64,
    /// The light at which it is shown (ns).
    pub shows_ns: i64,
}

#[derive(Debug)]
struct State {
    /// The light of the first request, at which a path begins (ns).
    begun_ns: Option<i64>,
    shot: Option<Shot>,
    /// The time of the decision (ns).
    decided_ns: i64,
    /// True for an eye that has the views of the shot.
    has: [bool; 2],
    /// True for an eye that takes part.
    is_there: [bool; 2],
}

/// One of the eyes that see the same camera. The camera moves on when all of them have their views of it, so that sets
/// of both eyes can show the same moment.
#[derive(Debug)]
pub(super) struct SharedCamera {
    eye: usize,
    state: Arc<Mutex<State>>,
}

impl SharedCamera {
    /// Makes the camera of one eye.
    pub fn alone() -> Self {
        let state = State { begun_ns: None, shot: None, decided_ns: 0, has: [false; 2], is_there: [true, false] };
        Self { eye: 0, state: Arc::new(Mutex::new(state)) }
    }

    /// Returns the same camera for the right eye.
    pub fn of_right_eye(&self) -> Self {
        self.change(|state| state.is_there[1] = true);
        Self { eye: 1, state: self.state.clone() }
    }

    /// Returns the light at which a path begins, which is the first one that an eye asks for (ns).
    pub fn begun_ns(&self, light_ns: i64) -> i64 {
        self.change(|state| *state.begun_ns.get_or_insert(light_ns))
    }

    /// Returns the present shot. It is replaced by this camera if all eyes have their views of the one before.
    pub fn shot(&self, camera: SplatCamera, shows_ns: i64, now_ns: i64) -> Shot {
        self.change(|state| {
            let before = match state.shot {
                Some(shot) if shot.camera == camera => return shot,
                before => before,
            };
            let waited_ns = now_ns.saturating_sub(state.decided_ns);
            let is_had = (0..2).all(|eye| state.has[eye] || !state.is_there[eye]);
            match before {
                Some(shot) if !is_had && waited_ns < PATIENCE_NS => shot,
                before => {
                    let shot = Shot { camera, moment: before.map_or(0, |shot| shot.moment + 1), shows_ns };
                    (state.shot, state.decided_ns, state.has) = (Some(shot), now_ns, [false; 2]);
                    shot
                }
            }
        })
    }

    /// States that this eye has its views of a shot.
    pub fn taken(&self, shot: &Shot) {
        self.change(|state| state.has[self.eye] |= state.shot.is_some_and(|now| now.moment == shot.moment));
    }

    fn change<T>(&self, change: impl FnOnce(&mut State) -> T) -> T {
        change(&mut self.state.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Drop for SharedCamera {
    fn drop(&mut self) {
        let eye = self.eye;
        self.change(|state| state.is_there[eye] = false);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    fn camera(x: f64) -> SplatCamera {
        SplatCamera { place: [x, 0.0, 0.0], axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], field: 0.7 }
    }

    #[test]
    fn the_camera_moves_on_when_both_eyes_have_it() {
        let left = SharedCamera::alone();
        let right = left.of_right_eye();
        let first = left.shot(camera(0.0), 100, 0);
        assert_eq!((first, first.moment), (right.shot(camera(1.0), 200, MS), 0), "the left eye was faster");
        left.taken(&first);
        assert_eq!(left.shot(camera(2.0), 300, 2 * MS), first, "the right eye has no views");
        right.taken(&first);
        let second = right.shot(camera(3.0), 400, 3 * MS);
        assert_eq!(second, Shot { camera: camera(3.0), moment: 1, shows_ns: 400 });
        // Views of an earlier shot do not count.
        left.taken(&first);
        right.taken(&second);
        assert_eq!(right.shot(camera(4.0), 500, 4 * MS), second);
        // An eye that draws nothing or has ended does not stop the other one.
        assert_eq!(right.shot(camera(4.0), 500, 3 * MS + PATIENCE_NS).moment, 2);
        drop(left);
        right.taken(&right.shot(camera(4.0), 500, 4 * MS));
        assert_eq!(right.shot(camera(5.0), 600, 3 * MS + PATIENCE_NS + 1).moment, 3);
    }

    #[test]
    fn the_camera_of_one_eye_moves_with_each_of_its_views() {
        let one = SharedCamera::alone();
        let first = one.shot(camera(0.0), 100, 0);
        assert_eq!(one.shot(camera(1.0), 200, 1), first);
        one.taken(&first);
        assert_eq!(one.shot(camera(0.0), 300, 2), first, "the camera is still");
        assert_eq!(one.shot(camera(1.0), 300, 2).moment, 1);
    }
}
