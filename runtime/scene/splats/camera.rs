//! Places a camera in front of splats, as stated, as in `cameras.json`, or so that most of the scene is in the picture.

use crate::SceneError;
use crate::splats::cloud::Cloud;
use crate::splats::options::Options;
use eyebox_base::error::Reason;
use eyebox_base::files::read;
use eyebox_base::reason;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Field of view across the shorter side in degrees, if nothing states it.
const FIELD: f64 = 40.0;
/// Share of the splats on each side that a camera leaves out if nothing states its position.
const OUTER: f64 = 0.05;
/// Levels of folders above the splats in which training writes `cameras.json`.
const ABOVE: usize = 2;

/// A camera in front of splats, in units of the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Position in units of the scene.
    pub place: [f64; 3],
    /// Directions to the right, downwards and forward in the picture, each of length 1.
    pub axes: [[f64; 3]; 3],
    /// Field of view across the shorter side in radians.
    pub field: f64,
}

/// A camera in the file that training writes.
#[derive(Deserialize)]
struct Trained {
    width: f64,
    height: f64,
    position: [f64; 3],
    /// Rows of the matrix from the camera to the scene.
    rotation: [[f64; 3]; 3],
    fx: f64,
    fy: f64,
}

/// Returns the file `cameras.json` next to a file of splats, or in the folders above it.
pub(crate) fn trained_file(splats: &Path) -> Option<PathBuf> {
    let whole = splats.canonicalize().ok()?;
    whole.ancestors().skip(1).take(1 + ABOVE).map(|folder| folder.join("cameras.json")).find(|file| file.is_file())
}

fn trained_cameras(file: &Path) -> Result<Vec<Trained>, SceneError> {
    let text = read::text(file, read::TABLE).map_err(|e| SceneError::unreadable(file, &e))?;
    let corrupt = |reason: Reason| SceneError::Corrupt { file: file.display().to_string(), reason };
    serde_json::from_str(&text).map_err(|e| corrupt(reason!("cameras", "{e}")))
}

impl Camera {
    /// Returns the camera of these splats. Its reason is the second value, in words.
    ///
    /// # Errors
    /// [`SceneError::Options`] for options that give no camera. [`SceneError::Corrupt`] for a damaged `cameras.json`.
    pub(crate) fn of(source: &Path, options: &Options, cloud: &Cloud) -> Result<(Self, String), SceneError> {
        let wrong = |reason: Reason| SceneError::Options { scene: source.display().to_string(), reason };
        let stated = options.eye.is_some() || options.at.is_some() || options.up.is_some();
        let file = if stated { None } else { trained_file(source) };
        let Some(file) = file else {
            if options.camera.is_some() {
                return Err(wrong(reason!("no-cameras", "there is no cameras.json next to the splats or above them")));
            }
            let camera = Self::stated(options, cloud).map_err(wrong)?;
            let how = if stated { "as stated" } else { "in front of the scene" };
            return Ok((camera, how.into()));
        };
        let corrupt = |reason: Reason| SceneError::Corrupt { file: file.display().to_string(), reason };
        let all = trained_cameras(&file)?;
        let index = options.camera.unwrap_or(0);
        let Some(trained) = all.get(index) else {
            return Err(wrong(reason!("no-camera", "camera {index} of {} in {}", all.len(), file.display())));
        };
        let camera = Self::trained(trained, options.fov).map_err(corrupt)?;
        Ok((camera, format!("camera {index} of {}", file.display())))
    }

    /// Reads all cameras of a file like `cameras.json`.
    ///
    /// # Errors
    /// [`SceneError::Corrupt`] for a file that is not valid or has no cameras, and the errors of reading it.
    pub fn all_of(file: &Path) -> Result<Vec<Self>, SceneError> {
        let corrupt = |reason: Reason| SceneError::Corrupt { file: file.display().to_string(), reason };
        let all = trained_cameras(file)?;
        if all.is_empty() {
            return Err(corrupt(reason!("cameras", "it has no cameras")));
        }
        all.iter().map(|trained| Self::trained(trained, None).map_err(corrupt)).collect()
    }

    fn trained(trained: &Trained, fov: Option<f64>) -> Result<Self, Reason> {
        let column = |i: usize| trained.rotation.map(|row| row[i]);
        let axes = [column(0), column(1), column(2)];
        let is_rotation = axes.iter().enumerate().all(|(i, a)| {
            axes.iter().enumerate().all(|(j, b)| (dot(*a, *b) - f64::from(u8::from(i == j))).abs() < 1e-2)
        });
        let (side, focal) =
            if trained.width < trained.height { (trained.width, trained.fx) } else { (trained.height, trained.fy) };
        let field = fov.map_or(2.0 * (side / (2.0 * focal)).atan(), f64::to_radians);
        let finite = trained.position.iter().all(|v| v.abs() <= 1e9);
        if !is_rotation || !finite || !(1e-3..3.0).contains(&field) {
            return Err(reason!("cameras", "a camera in it is not valid"));
        }
        Ok(Self { place: trained.position, axes, field })
    }

    /// Places the camera by the options, and in front of the scene without them.
    fn stated(options: &Options, cloud: &Cloud) -> Result<Self, Reason> {
        let field = options.fov.unwrap_or(FIELD).to_radians();
        let range = |axis: usize| {
            let mut values: Vec<f32> = cloud.places.iter().map(|place| place[axis]).collect();
            values.sort_unstable_by(f32::total_cmp);
            let outer = (OUTER * values.len() as f64) as usize;
            [values[outer], values[values.len() - 1 - outer]].map(f64::from)
        };
        let ranges = [range(0), range(1), range(2)];
        let middle = ranges.map(|[low, high]| (low + high) / 2.0);
        let half = ranges.map(|[low, high]| (high - low) / 2.0);
        let away = (half[0].max(half[1]) / (field / 2.0).tan() + half[2]).max(1e-3);
        let default = [middle[0], middle[1], middle[2] - away];
        let place = options.eye.unwrap_or(if options.at.is_some() {
            let at = options.at.unwrap_or(middle);
            [at[0], at[1], at[2] - away]
        } else {
            default
        });
        let forward = match options.at {
            Some(at) => normal(minus(at, place)).ok_or_else(|| reason!("camera", "eye and at are the same point"))?,
            None => [0.0, 0.0, 1.0],
        };
        // The vertical direction of files points downwards.
        let up = options.up.unwrap_or([0.0, -1.0, 0.0]);
        let axes = upright(forward, up).ok_or_else(|| reason!("camera", "up is the direction of the view"))?;
        Ok(Self { place, axes, field })
    }

    /// Returns a point of the scene in the axes of the camera.
    pub(crate) fn seen(&self, point: [f32; 3]) -> [f32; 3] {
        let from = minus(point.map(f64::from), self.place);
        self.axes.map(|axis| dot(axis, from) as f32)
    }
}

/// Returns the axes of a camera in a direction of length 1, with `up` upwards. It is `None` if both are the same.
pub(crate) fn upright(forward: [f64; 3], up: [f64; 3]) -> Option<[[f64; 3]; 3]> {
    let right = normal(cross(forward, up))?;
    Some([right, cross(forward, right), forward])
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

pub(crate) fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(crate) fn normal(a: [f64; 3]) -> Option<[f64; 3]> {
    let length = dot(a, a).sqrt();
    (length > 1e-9).then(|| a.map(|v| v / length))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud() -> Cloud {
        let mut cloud = Cloud::default();
        for i in 0..101 {
            let v = i as f32 / 50.0 - 1.0;
            cloud.places.push([v, 2.0 * v, 5.0 + v]);
        }
        cloud
    }

    #[test]
    fn a_camera_in_front_sees_the_scene_upright() {
        let (camera, _) = Camera::of(Path::new("/x.ply"), &Options::default(), &cloud()).unwrap();
        assert_eq!(camera.axes, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        let tangent = (camera.field / 2.0).tan();
        for place in cloud().places.iter().skip(6).take(89) {
            let [x, y, z] = camera.seen(*place).map(f64::from);
            assert!(z > 0.0 && x.abs() <= tangent * z && y.abs() <= tangent * z, "{x} {y} {z}");
        }
    }

    #[test]
    fn a_stated_camera_looks_at_its_point() {
        let options = Options::parse("eye=3,0,0&at=0,0,0&fov=60").unwrap();
        let (camera, _) = Camera::of(Path::new("/x.ply"), &options, &cloud()).unwrap();
        let close = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
        // From +x, the far side of the scene (+z) is at the right, and +y is still downwards.
        assert!(close(camera.seen([0.0; 3]), [0.0, 0.0, 3.0]));
        assert!(close(camera.seen([0.0, 1.0, 1.0]), [1.0, 1.0, 3.0]), "{:?}", camera.seen([0.0, 1.0, 1.0]));
        let same = Options::parse("eye=1,1,1&at=1,1,1").unwrap();
        assert!(matches!(Camera::of(Path::new("/x.ply"), &same, &cloud()), Err(SceneError::Options { .. })));
        let along = Options::parse("eye=0,0,0&at=0,1,0").unwrap();
        assert!(matches!(Camera::of(Path::new("/x.ply"), &along, &cloud()), Err(SceneError::Options { .. })));
    }

    #[test]
    fn cameras_of_training_are_found_above_the_splats() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("point_cloud/iteration_7000");
        std::fs::create_dir_all(&inner).unwrap();
        let splats = inner.join("point_cloud.ply");
        std::fs::write(&splats, "").unwrap();
        let camera = |x: f64| {
            serde_json::json!({"id": 0, "width": 800, "height": 600, "position": [x, 0, 0], "fx": 700.0, "fy": 600.0,
                "rotation": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]})
        };
        std::fs::write(folder.path().join("cameras.json"), serde_json::json!([camera(1.0), camera(2.0)]).to_string())
            .unwrap();
        let at = |query: &str| Camera::of(&splats, &Options::parse(query).unwrap(), &cloud());
        let (first, _) = at("").unwrap();
        // The axis of the camera is the column of its rotation, which is +x.
        assert_eq!((first.place[0], first.axes[2]), (1.0, [1.0, 0.0, 0.0]));
        assert!((first.field - 2.0 * 0.5f64.atan()).abs() < 1e-12);
        assert_eq!(at("camera=1").unwrap().0.place[0], 2.0);
        assert!(matches!(at("camera=2"), Err(SceneError::Options { .. })));
        assert_eq!(at("eye=0,0,0").unwrap().0.place, [0.0; 3]);
        std::fs::write(folder.path().join("cameras.json"), "[{}]").unwrap();
        assert!(matches!(at(""), Err(SceneError::Corrupt { .. })));
    }
}
