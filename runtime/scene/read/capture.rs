//! Recognizes pictures of a camera that was carried around, by the files of cameras that other programs write.
//!
//! Their cameras are rarely in a grid, so their folders are no light fields. Programs that train splats take them.

use crate::{CamerasFound, SceneError};
use eyebox_base::files::{read, read_npy};
use serde::Deserialize;
use std::path::Path;

/// Files of cameras, relative to the folder of the pictures or to the folder around it.
const FILES: [&str; 7] = [
    "sparse/0/images.bin",
    "sparse/0/images.txt",
    "images.bin",
    "images.txt",
    "poses_bounds.npy",
    "transforms.json",
    "transforms_train.json",
];
/// Largest deviation of a camera from a grid, as a share of the distance of neighbors.
const OFF: f64 = 0.05;
/// Most cameras that are read.
const MOST: usize = 1 << 16;

/// The camera of one picture.
struct Camera {
    center: [f64; 3],
    /// Directions to the right and downwards in the picture.
    right: [f64; 3],
    down: [f64; 3],
}

/// Refuses a folder of pictures for which there are cameras of another program.
///
/// # Errors
/// [`SceneError::Cameras`] with the grid of the cameras, if there is one.
pub(crate) fn refused(folder: &Path) -> Result<(), SceneError> {
    if folder.join("lightfield.toml").is_file() || folder.join("parameters.cfg").is_file() {
        return Ok(());
    }
    let around = folder.canonicalize().ok().and_then(|whole| whole.parent().map(Path::to_path_buf));
    // The folder around belongs to the capture only if this one has its usual name.
    let is_usual = folder.file_name().is_some_and(|name| name.to_string_lossy().starts_with("images"));
    let places = [Some(folder.to_path_buf()), around.filter(|_| is_usual)];
    for file in places.iter().flatten().flat_map(|place| FILES.map(|name| place.join(name))) {
        let Some(cameras) = cameras(&file).filter(|all| all.len() > 1) else { continue };
        let found = CamerasFound::Carried { count: cameras.len(), grid: grid(&cameras) };
        return Err(SceneError::Cameras { scene: folder.display().to_string(), found });
    }
    Ok(())
}

/// Reads the cameras of a file. It returns `None` for a file that does not exist or is damaged.
fn cameras(file: &Path) -> Option<Vec<Camera>> {
    if !file.is_file() {
        return None;
    }
    let name = file.file_name()?.to_string_lossy();
    match &*name {
        "images.bin" => colmap_binary(&read::bytes(file, read::RESULTS).ok()?),
        "images.txt" => colmap_text(&read::text(file, read::RESULTS).ok()?),
        "poses_bounds.npy" => llff(file),
        _ => nerf(&read::text(file, read::TABLE).ok()?),
    }
}

/// Returns the camera of a turn (w, x, y, z) and a shift from the scene to the camera.
fn of_pose([w, x, y, z]: [f64; 4], shift: [f64; 3]) -> Camera {
    let rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ];
    let center = [0, 1, 2].map(|i| -(0..3).map(|k| rows[k][i] * shift[k]).sum::<f64>());
    Camera { center, right: rows[0], down: rows[1] }
}

/// Reads the cameras of COLMAP's text, whose every second line has the points of a picture.
fn colmap_text(text: &str) -> Option<Vec<Camera>> {
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    let one = |line: &str| {
        let numbers: Vec<f64> = line.split_whitespace().take(8).map(|v| v.parse().ok()).collect::<Option<_>>()?;
        let [_, w, x, y, z, a, b, c] = <[f64; 8]>::try_from(numbers).ok()?;
        Some(of_pose([w, x, y, z], [a, b, c]))
    };
    lines.step_by(2).take(MOST).map(one).collect()
}

/// Reads the cameras of COLMAP's binary file.
fn colmap_binary(bytes: &[u8]) -> Option<Vec<Camera>> {
    let word = |at: usize| Some(u64::from_le_bytes(bytes.get(at..at.checked_add(8)?)?.try_into().ok()?));
    let count = usize::try_from(word(0)?).ok().filter(|count| *count <= MOST)?;
    let (mut at, mut all) = (8usize, Vec::new());
    for _ in 0..count {
        let number = |i: usize| word(at + 4 + 8 * i).map(f64::from_bits);
        let turn = [number(0)?, number(1)?, number(2)?, number(3)?];
        all.push(of_pose(turn, [number(4)?, number(5)?, number(6)?]));
        let name = at + 4 + 56 + 4;
        let end = name + bytes.get(name..)?.iter().position(|byte| *byte == 0)? + 1;
        let points = usize::try_from(word(end)?).ok()?;
        at = points.checked_mul(24)?.checked_add(end + 8).filter(|at| *at <= bytes.len())?;
    }
    Some(all)
}

/// Reads `poses_bounds.npy` of LLFF, whose columns are down, right, backwards, the center, and the picture.
fn llff(file: &Path) -> Option<Vec<Camera>> {
    let array = read_npy(file).ok().filter(|array| array.shape.len() == 2 && array.shape[1] == 17)?;
    let one = |row: &[f32]| {
        let column = |i: usize| [0, 5, 10].map(|k| f64::from(row[k + i]));
        Camera { center: column(3), right: column(1), down: column(0) }
    };
    Some(array.values.chunks_exact(17).take(MOST).map(one).collect())
}

/// Reads `transforms.json` of NeRF, whose matrices have the columns right, up, backwards and the center.
fn nerf(text: &str) -> Option<Vec<Camera>> {
    #[derive(Deserialize)]
    struct File {
        frames: Vec<Frame>,
    }
    #[derive(Deserialize)]
    struct Frame {
        transform_matrix: [[f64; 4]; 4],
    }
    let file: File = serde_json::from_str(text).ok()?;
    let one = |frame: &Frame| {
        let column = |i: usize| [0, 1, 2].map(|k| frame.transform_matrix[k][i]);
        Camera { center: column(3), right: column(0), down: column(1).map(|v| -v) }
    };
    Some(file.frames.iter().take(MOST).map(one).collect())
}

/// Returns the rows and columns of cameras in a plane grid, each with one camera.
fn grid(cameras: &[Camera]) -> Option<[usize; 2]> {
    let dot = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let (right, down) = (cameras[0].right, cameras[0].down);
    let forward = [
        right[1] * down[2] - right[2] * down[1],
        right[2] * down[0] - right[0] * down[2],
        right[0] * down[1] - right[1] * down[0],
    ];
    let first = cameras[0].center;
    let places: Vec<[f64; 3]> = (cameras.iter())
        .map(|camera| {
            let from = [0, 1, 2].map(|i| camera.center[i] - first[i]);
            [right, down, forward].map(|axis| dot(axis, from))
        })
        .collect();
    let distance = |a: &[f64; 3], b: &[f64; 3]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    let nearest = places.iter().skip(1).map(|place| distance(place, &places[0])).fold(f64::INFINITY, f64::min);
    if !(nearest > 0.0 && nearest.is_finite()) {
        return None;
    }
    let low = [0, 1].map(|i| places.iter().map(|place| place[i]).fold(f64::INFINITY, f64::min));
    let mut cells = Vec::with_capacity(places.len());
    for place in &places {
        let steps = [0, 1].map(|i| (place[i] - low[i]) / nearest);
        let off = steps.iter().map(|v| (v - v.round()).abs()).fold(place[2].abs() / nearest, f64::max);
        // A grid has at most as many rows and columns as cameras.
        if off.is_nan() || off > OFF || steps.iter().any(|step| *step > cameras.len() as f64) {
            return None;
        }
        cells.push([steps[1].round() as usize, steps[0].round() as usize]);
    }
    let size = [0, 1].map(|i| cells.iter().map(|cell| cell[i]).max().unwrap_or(0) + 1);
    cells.sort_unstable();
    cells.dedup();
    (cells.len() == places.len() && size[0].checked_mul(size[1]) == Some(cells.len())).then_some(size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    /// The centers of cameras in a grid of 2 rows and 3 columns, each off by at most this share of the distance.
    fn centers(off: f64) -> Vec<[f64; 3]> {
        (0..6).map(|i| [0.2 * f64::from(i % 3) + 0.2 * off * f64::from(i % 2), 0.2 * f64::from(i / 3), 1.0]).collect()
    }

    /// Cameras that are turned by half a turn about x, in COLMAP's text.
    fn text(centers: &[[f64; 3]]) -> String {
        let line = |(i, [x, y, z]): (usize, &[f64; 3])| format!("{i} 0 1 0 0 {} {y} {z} 1 p{i}.jpg\n1 2 -1\n", -x);
        format!("# text\n{}", centers.iter().enumerate().map(line).collect::<String>())
    }

    fn found(folder: &Path) -> Option<(usize, Option<[usize; 2]>)> {
        match refused(folder) {
            Ok(()) => None,
            Err(SceneError::Cameras { found: CamerasFound::Carried { count, grid }, .. }) => Some((count, grid)),
            Err(other) => panic!("{other}"),
        }
    }

    #[test]
    fn cameras_of_other_programs_are_refused_with_their_grid() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir_all(at("images")).unwrap();
        fs::create_dir_all(at("sparse/0")).unwrap();
        assert_eq!(found(folder.path()), None);
        fs::write(at("sparse/0/images.txt"), text(&centers(0.0))).unwrap();
        assert_eq!([found(folder.path()), found(&at("images"))], [Some((6, Some([2, 3]))); 2]);
        fs::write(at("sparse/0/images.txt"), text(&centers(0.04))).unwrap();
        assert_eq!(found(folder.path()), Some((6, Some([2, 3]))));
        fs::write(at("sparse/0/images.txt"), text(&centers(0.2))).unwrap();
        assert_eq!(found(folder.path()), Some((6, None)));
        fs::remove_file(at("sparse/0/images.txt")).unwrap();
        let mut bytes = 6u64.to_le_bytes().to_vec();
        for [x, y, z] in centers(0.0) {
            bytes.extend([1, 0, 0, 0]);
            bytes.extend([1.0, 0.0, 0.0, 0.0, -x, -y, -z].iter().flat_map(|v: &f64| v.to_le_bytes()));
            bytes.extend(b"\x01\0\0\0name.jpg\0");
            bytes.extend([&1u64.to_le_bytes()[..], &[0; 24]].concat());
        }
        fs::write(at("images.bin"), &bytes).unwrap();
        assert_eq!(found(folder.path()), Some((6, Some([2, 3]))));
        fs::write(at("images.bin"), &bytes[..bytes.len() - 30]).unwrap();
        assert_eq!(found(folder.path()), None, "a damaged file decides nothing");
        // The number of points of the first picture ends near the largest place.
        let of_first = 8 + 4 + 56 + 4 + "name.jpg\0".len();
        let points = (usize::MAX - of_first - 8) / 24;
        bytes[of_first..of_first + 8].copy_from_slice(&(points as u64).to_le_bytes());
        fs::write(at("images.bin"), &bytes).unwrap();
        assert_eq!(found(folder.path()), None, "a damaged file decides nothing");
        let row = |[x, y, z]: [f64; 3]| {
            let of = |k: usize| [[0.0, 1.0, 0.0, x, 9.0], [1.0, 0.0, 0.0, y, 9.0], [0.0, 0.0, -1.0, z, 9.0]][k];
            (0..3).flat_map(of).chain([1.0, 9.0]).map(|v| v as f32).collect::<Vec<f32>>()
        };
        let values: Vec<f32> = centers(0.0).into_iter().flat_map(row).collect();
        eyebox_base::files::write_npy(&at("poses_bounds.npy"), &[6, 17], &values).unwrap();
        assert_eq!(found(folder.path()), Some((6, Some([2, 3]))));
        fs::write(at("lightfield.toml"), "grid = [2, 3]").unwrap();
        assert_eq!(found(folder.path()), None, "the folder states its grid");
    }

    #[test]
    fn cameras_that_are_very_far_apart_are_no_grid() {
        let at = |x: f64| Camera { center: [x, 0.0, 0.0], right: [1.0, 0.0, 0.0], down: [0.0, 1.0, 0.0] };
        assert_eq!(grid(&[at(0.0), at(1.0), at(1e300)]), None);
        assert_eq!(grid(&[at(0.0), at(1.0), at(2.0)]), Some([1, 3]));
    }

    #[test]
    fn matrices_of_nerf_have_their_centers_in_the_last_column() {
        let frame = |x: f64, y: f64| serde_json::json!({"transform_matrix": [[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, 0], [0, 0, 0, 1]]});
        let frames = |more: f64| serde_json::json!({"frames": [frame(0.0, 0.0), frame(1.0, 0.0), frame(more, 0.0)]});
        let of = |more: f64| grid(&nerf(&frames(more).to_string()).unwrap());
        assert_eq!([of(2.0), of(2.3), of(1.0)], [Some([1, 3]), None, None]);
        assert!(nerf("{}").is_none());
    }
}
