//! Moves a camera in front of splats, by steps and along a path.

use crate::SceneError;
use crate::splats::camera::{Camera, minus, normal, upright};
use std::f64::consts::TAU;
use std::path::Path;

/// Reach of the built-in path to the sides, in proportion to the distance of the point that the camera looks at.
const REACH: f64 = 0.12;
/// The reach upwards and towards that point, in proportion to the reach to the sides.
const RISE: f64 = 0.35;
const NEARER: f64 = 0.8;

/// A path of a camera, which begins again at its end.
#[derive(Debug, Clone, PartialEq)]
pub enum CameraPath {
    /// The camera moves to both sides of its start and back, towards the scene and away, and looks at one point.
    Around {
        /// The camera at the start.
        start: Camera,
        /// Distance of the point that it looks at, in units of the scene.
        distance: f64,
    },
    /// The camera moves from each of these cameras to the next, and back the same way.
    Along(Vec<Camera>),
}

impl CameraPath {
    /// Reads the cameras of a path from a file like the `cameras.json` of training.
    ///
    /// # Errors
    /// The errors of [`Camera::all_of`].
    pub fn read(file: &Path) -> Result<Self, SceneError> {
        Camera::all_of(file).map(Self::Along)
    }

    /// Returns the camera at this number of rounds of the path.
    pub fn at(&self, rounds: f64) -> Camera {
        let share = rounds.rem_euclid(1.0);
        match self {
            Self::Around { start, distance } => {
                let (angle, reach) = (TAU * share, REACH * distance);
                let by = [
                    reach * angle.sin(),
                    -RISE * reach * (2.0 * angle).sin(),
                    NEARER * reach * (0.5 - 0.5 * angle.cos()),
                ];
                start.moved(by).towards(start.moved([0.0, 0.0, *distance]).place)
            }
            Self::Along(cameras) => {
                let last = cameras.len().saturating_sub(1);
                let at = last as f64 * (1.0 - (2.0 * share - 1.0).abs());
                let before = (at as usize).min(last.saturating_sub(1));
                cameras[before].between(&cameras[(before + 1).min(last)], at - before as f64)
            }
        }
    }
}

impl Camera {
    /// Returns the camera after a displacement to the right, downwards and forward in its own axes, in units of the
    /// scene.
    #[must_use]
    pub fn moved(&self, by: [f64; 3]) -> Self {
        let sum = |i: usize| (0..3).map(|axis| by[axis] * self.axes[axis][i]).sum::<f64>();
        Self { place: [0, 1, 2].map(|i| self.place[i] + sum(i)), ..*self }
    }

    /// Returns the camera after a turn to the right and downwards in radians.
    #[must_use]
    pub fn turned(&self, [right, down]: [f64; 2]) -> Self {
        let mix = |a: [f64; 3], b: [f64; 3], angle: f64| [0, 1, 2].map(|i| a[i] * angle.cos() + b[i] * angle.sin());
        let [x, y, z] = self.axes;
        let [x, z] = [mix(x, z, -right), mix(z, x, right)];
        let [y, z] = [mix(y, z, -down), mix(z, y, down)];
        Self { axes: [x, y, z], ..*self }
    }

    /// Returns the camera in the direction of a point. It is unchanged if the point is straight above or below.
    #[must_use]
    pub fn towards(&self, point: [f64; 3]) -> Self {
        let up = self.axes[1].map(|v| -v);
        let axes = normal(minus(point, self.place)).and_then(|forward| upright(forward, up));
        Self { axes: axes.unwrap_or(self.axes), ..*self }
    }

    /// Returns a camera between two others, at this share of the way.
    #[must_use]
    pub fn between(&self, other: &Self, share: f64) -> Self {
        let mix = |a: f64, b: f64| a + share * (b - a);
        let all = |a: [f64; 3], b: [f64; 3]| [0, 1, 2].map(|i| mix(a[i], b[i]));
        let up = all(self.axes[1], other.axes[1]).map(|v| -v);
        // Opposite cameras have no direction between them.
        let axes = normal(all(self.axes[2], other.axes[2])).and_then(|forward| upright(forward, up));
        Self {
            place: all(self.place, other.place),
            axes: axes.unwrap_or(self.axes),
            field: mix(self.field, other.field),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        let (place, axes) = ([1.0, 2.0, 3.0], [[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]);
        Camera { place, axes, field: 0.7 }
    }

    fn close(a: [f64; 3], b: [f64; 3]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9)
    }

    #[test]
    fn a_camera_moves_in_its_own_axes_and_turns_around_them() {
        let start = camera();
        assert!(close(start.moved([1.0, 2.0, 4.0]).place, [5.0, 4.0, 2.0]));
        let right = start.turned([std::f64::consts::FRAC_PI_2, 0.0]);
        assert!(close(right.axes[2], start.axes[0]) && close(right.axes[1], start.axes[1]), "{right:?}");
        let down = start.turned([0.0, std::f64::consts::FRAC_PI_2]);
        assert!(close(down.axes[2], start.axes[1]) && close(down.axes[0], start.axes[0]), "{down:?}");
        let back = start.turned([0.3, 0.2]).turned([0.0, -0.2]).turned([-0.3, 0.0]);
        assert!((0..3).all(|i| close(back.axes[i], start.axes[i])), "{back:?}");
    }

    #[test]
    fn the_built_in_path_looks_at_one_point_and_closes() {
        let path = CameraPath::Around { start: camera(), distance: 5.0 };
        let point = camera().moved([0.0, 0.0, 5.0]).place;
        for step in 0..20 {
            let at = path.at(f64::from(step) / 20.0);
            assert!(close(at.axes[2], normal(minus(point, at.place)).unwrap()), "{at:?}");
            let next = path.at((f64::from(step) + 1.0) / 20.0);
            assert!(at.place != next.place);
        }
        assert!(close(path.at(0.0).place, camera().place) && close(path.at(3.0).axes[0], camera().axes[0]));
        // A quarter of a round is at the right, and three quarters are at the left.
        assert!(close(path.at(0.25).place, camera().moved([0.6, 0.0, 0.24]).place), "{:?}", path.at(0.25));
        assert!(close(path.at(0.75).place, camera().moved([-0.6, 0.0, 0.24]).place));
    }

    #[test]
    fn a_path_of_cameras_goes_there_and_back() {
        let to = |z: f64| Camera { place: [0.0, 0.0, z], ..camera() };
        let path = CameraPath::Along(vec![to(0.0), to(2.0), to(3.0)]);
        for (rounds, z) in [(0.0, 0.0), (0.125, 1.0), (0.25, 2.0), (0.5, 3.0), (0.75, 2.0), (1.0, 0.0), (2.125, 1.0)] {
            assert!(close(path.at(rounds).place, [0.0, 0.0, z]), "{rounds}: {:?}", path.at(rounds));
        }
        assert_eq!(CameraPath::Along(vec![camera()]).at(0.3).place, camera().place);
        let half = camera().between(&camera().turned([0.4, 0.0]), 0.5);
        assert!(close(half.axes[2], camera().turned([0.2, 0.0]).axes[2]));
    }

    #[test]
    fn a_path_is_read_from_cameras() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("path.json");
        assert!(CameraPath::read(&file).is_err());
        std::fs::write(&file, "[]").unwrap();
        assert!(matches!(CameraPath::read(&file), Err(SceneError::Corrupt { .. })));
        let camera = |x: f64| {
            serde_json::json!({"width": 80, "height": 60, "position": [x, 0, 0], "fx": 60.0, "fy": 60.0,
                "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]})
        };
        std::fs::write(&file, serde_json::json!([camera(1.0), camera(2.0)]).to_string()).unwrap();
        assert!(close(CameraPath::read(&file).unwrap().at(0.25).place, [1.5, 0.0, 0.0]));
    }
}
