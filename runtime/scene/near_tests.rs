//! Tests depth maps as cameras, benchmarks, networks and renderers store them. Each is read with the right depths, or
//! refused until the caller states which values are near.

use crate::SceneError;
use crate::depth::map;
use crate::light_field::near::{Meaning, Near, Stated};
use std::path::{Path, PathBuf};

const N: usize = 16;
const DEPTHS: Option<[f64; 2]> = Some([-1e-3, 1e-3]);

/// Returns a scene that recedes from `near` on the left to `far` on the right, in meters.
fn distances(near: f32, far: f32) -> Vec<f32> {
    (0..N * N).map(|i| near + (far - near) * (i % N) as f32 / (N - 1) as f32).collect()
}

/// Marks a block of pixels in the middle as unknown.
fn with_hole(mut values: Vec<f32>, unknown: f32) -> Vec<f32> {
    for row in 5..9 {
        values[row * N + 6..row * N + 9].fill(unknown);
    }
    values
}

fn write(folder: &Path, name: &str, values: &[f32]) -> PathBuf {
    let path = folder.join(name);
    match path.extension().and_then(|e| e.to_str()) {
        Some("png") if name.contains("8bit") => {
            let pixel = |x: u32, y: u32| image::Luma([values[y as usize * N + x as usize] as u8]);
            image::ImageBuffer::from_fn(N as u32, N as u32, pixel).save(&path).unwrap();
        }
        Some("png") => {
            let pixel = |x: u32, y: u32| image::Luma([values[y as usize * N + x as usize] as u16]);
            image::ImageBuffer::from_fn(N as u32, N as u32, pixel).save(&path).unwrap();
        }
        Some("pfm") => {
            let mut bytes = format!("Pf\n{N} {N}\n-1\n").into_bytes();
            values.chunks_exact(N).rev().flatten().for_each(|v| bytes.extend(v.to_le_bytes()));
            std::fs::write(&path, bytes).unwrap();
        }
        _ => return write_gaps(folder, name, values),
    }
    path
}

/// Writes float32 values that need not be finite.
fn write_gaps(folder: &Path, name: &str, values: &[f32]) -> PathBuf {
    let path = folder.join(name);
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    std::fs::write(&path, [eyebox_base::files::npy_header("<f4", &[N, N]), bytes].concat()).unwrap();
    path
}

/// Returns the nearness of each pixel, 0 at the farthest and 1 at the nearest.
fn nearness(map: &map::Map) -> Vec<f32> {
    let ends = map.values.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[a, b], &v| [a.min(v), b.max(v)]);
    let larger = !matches!(map.meaning, Meaning::Relative(near) if !near.is_larger());
    let share = |v: &f32| (v - ends[0]) / (ends[1] - ends[0]);
    map.values.iter().map(|v| if larger { share(v) } else { 1.0 - share(v) }).collect()
}

/// Returns the name of the file, its values, and the word for `near` that the writer of such a file would choose.
fn integer_maps() -> Vec<(&'static str, Vec<f32>, Near)> {
    let scaled =
        |near, far, scale: f32| -> Vec<f32> { distances(near, far).into_iter().map(|z| (z * scale).round()).collect() };
    let closeness: Vec<f32> = distances(1.0, 0.0);
    let of = |low: f32, high: f32| -> Vec<f32> { closeness.iter().map(|d| (low + d * (high - low)).round()).collect() };
    let normalized_depth: Vec<f32> = closeness.iter().map(|d| ((1.0 - d) * 65535.0).round()).collect();
    vec![
        ("tum.png", with_hole(scaled(0.7, 7.7, 5000.0), 0.0), Near::Small),
        ("tum_far.png", with_hole(scaled(0.7, 13.0, 5000.0), 0.0), Near::Small),
        ("rgbd_scenes_depth.png", with_hole(scaled(0.5, 6.0, 10000.0), 0.0), Near::Small),
        ("kitti_completed.png", scaled(4.0, 80.0, 256.0), Near::Small),
        ("void.png", with_hole(scaled(0.3, 8.0, 256.0), 0.0), Near::Small),
        ("zoe.png", scaled(0.7, 8.7, 256.0), Near::Small),
        ("kinect.png", with_hole(scaled(0.7, 3.2, 1000.0), 0.0), Near::Small),
        ("kinect_filled.png", scaled(0.7, 9.5, 1000.0), Near::Small),
        ("realsense_far.png", with_hole(scaled(0.5, 4.0, 1000.0), 65535.0), Near::Small),
        ("deep_room.png", with_hole(scaled(0.2, 12.0, 5000.0), 0.0), Near::Small),
        ("servct.png", with_hole(scaled(60.0, 210.0, 256.0), 0.0), Near::Small),
        ("hypersim_mm.png", scaled(1.0, 20.0, 1000.0), Near::Small),
        ("kitti_disparity.png", with_hole(of(12.0 * 256.0, 90.0 * 256.0), 0.0), Near::Large),
        ("midas.png", of(2000.0, 57000.0), Near::Large),
        ("midas_normalized.png", of(0.0, 65535.0), Near::Bright),
        ("marigold.png", normalized_depth, Near::Dark),
    ]
}

/// Maps of 16 bits never show which values are near. After the remedy of the refusal, depths are right and unknown
/// pixels count in none.
#[test]
fn sixteen_bits_are_refused_until_near_is_stated() {
    let folder = tempfile::tempdir().unwrap();
    let wanted = distances(1.0, 0.0);
    for (name, values, near) in integer_maps() {
        let path = write(folder.path(), name, &values);
        let refused = map::read(&path, Stated::default());
        assert!(matches!(refused, Err(SceneError::Ambiguous { .. })), "{name}");
        assert!(matches!(map::read(&path, Stated { depth: DEPTHS, near: None }), Err(SceneError::Ambiguous { .. })));
        let map = map::read(&path, Stated { near: Some(near), depth: DEPTHS }).unwrap();
        for (i, (found, wanted)) in nearness(&map).into_iter().zip(&wanted).enumerate() {
            let hole = (5..9).contains(&(i / N)) && (6..9).contains(&(i % N));
            let most = if hole { 0.25 } else { 0.002 };
            assert!((found - wanted).abs() < most, "{name}, pixel {i}: {found} for {wanted}");
        }
    }
}

/// Values that are not distances never become the nearest or the farthest depth.
#[test]
fn no_unknown_value_is_a_distance() {
    let folder = tempfile::tempdir().unwrap();
    let wanted = distances(1.0, 0.0);
    let (scene, deep) = (distances(1.0, 9.0), distances(0.5, 60.0));
    for unknown in [0.0, -1.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e10, f32::MAX, 65504.0, 1e9, 1e5, -9999.0] {
        for values in [&scene, &deep] {
            let path = write_gaps(folder.path(), "depth.npy", &with_hole(values.clone(), unknown));
            for near in [Some(Near::Small), None] {
                let map = map::read(&path, Stated { near, depth: None }).unwrap_or_else(|e| panic!("{unknown}: {e}"));
                for (i, (found, wanted)) in nearness(&map).into_iter().zip(&wanted).enumerate() {
                    assert!((found - wanted).abs() < 0.25, "{unknown}, pixel {i}: {found} for {wanted}");
                }
            }
        }
    }
    let millimeters: Vec<f32> = with_hole(scene.iter().map(|z| (z * 1000.0).round()).collect(), 65535.0);
    let map = map::read(&write(folder.path(), "depth.npy", &millimeters), Stated::default()).unwrap();
    assert!(map.values.iter().all(|v| *v <= 9000.0));
}

/// Disparities mark unknown pixels with infinity (Middlebury) or with zeros (KITTI).
#[test]
fn unknown_disparities_are_filled_with_the_farther_neighbor() {
    let folder = tempfile::tempdir().unwrap();
    let wanted = distances(1.0, 0.0);
    let disparities = distances(60.0, 20.0);
    for unknown in [f32::INFINITY, f32::NAN, 0.0, 1e10] {
        let path = write(folder.path(), "disp0.pfm", &with_hole(disparities.clone(), unknown));
        for stated in
            [Stated::default(), Stated { near: None, depth: DEPTHS }, Stated { near: Some(Near::Large), depth: DEPTHS }]
        {
            let map = map::read(&path, stated).unwrap();
            let absolute = map.meaning == Meaning::Disparity;
            assert_eq!(absolute, stated.depth.is_none(), "stated depths scale disparities");
            for (found, wanted) in nearness(&map).into_iter().zip(&wanted) {
                assert!((found - wanted).abs() < 0.25, "{unknown}: {found} for {wanted}");
            }
        }
    }
    // Gaps between the values of a scene may be wider than the gap below them.
    let near_and_far: Vec<f32> = (0..N * N).map(|i| if i % N < 5 { 200.0 } else { 20.0 + i as f32 / 8.0 }).collect();
    for name in ["kitti.npy", "disp2-8bit.png"] {
        let values = with_hole(near_and_far.iter().map(|v| v.round()).collect(), 0.0);
        let stated = Stated { near: name.starts_with("kitti").then_some(Near::Large), depth: DEPTHS };
        let map = map::read(&write(folder.path(), name, &values), stated).unwrap();
        assert!(map.values.iter().all(|v| *v >= 20.0), "{name}");
    }
    // Zero is the farthest of several layers.
    for layers in [4, 2] {
        let values: Vec<f32> = (0..N * N).map(|i| (i % N * layers / N) as f32).collect();
        let path = write(folder.path(), "layers.npy", &values);
        let map = map::read(&path, Stated { near: Some(Near::Large), depth: DEPTHS }).unwrap();
        assert_eq!(map.values, values);
    }
    // Disparities of a light field are on both sides of 0, which is a value.
    let both = distances(2.0, -2.0);
    let map = map::read(&write(folder.path(), "disp.pfm", &with_hole(both, 0.0)), Stated::default()).unwrap();
    assert_eq!(map.values[6 * N + 7], 0.0);
}

/// Floats are refused if their name says distances and their values cannot be distances, or if nothing says what they
/// are.
#[test]
fn floats_that_contradict_their_name_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let closeness = distances(1.0, 0.0);
    let cases: [(&str, Vec<f32>, Near); 10] = [
        ("depth.npy", closeness.clone(), Near::Bright),
        ("photo_depth.npy", closeness.iter().map(|d| d * 255.0).collect(), Near::Bright),
        ("depth.pfm", closeness.iter().map(|d| 0.001 + d).collect(), Near::Large),
        ("depth.pfm", closeness.iter().map(|d| 1.0 - d).collect(), Near::Dark),
        ("z.npy", distances(-2.0, -8.0), Near::Large),
        ("depth.npy", distances(-1.0, 5.0), Near::Small),
        ("prediction.npy", closeness.iter().map(|d| 2000.0 + d * 8000.0).collect(), Near::Large),
        ("pred.pfm", distances(0.7, 8.7), Near::Small),
        ("inverse_depth.npy", closeness.iter().map(|d| 0.1 + d).collect(), Near::Large),
        ("map.npy", distances(0.7, 8.7), Near::Small),
    ];
    for (name, values, near) in cases {
        let path = write(folder.path(), name, &values);
        let refused = map::read(&path, Stated::default());
        assert!(matches!(refused, Err(SceneError::Ambiguous { .. })), "{name}");
        let map = map::read(&path, Stated { near: Some(near), depth: None }).unwrap();
        for (i, (found, wanted)) in nearness(&map).into_iter().zip(&closeness).enumerate() {
            assert!((found - wanted).abs() < 0.08, "{name}, pixel {i}: {found} for {wanted}");
        }
    }
}

/// A map with few known pixels is refused, and is read after its remedy, completed with the nearest value.
#[test]
fn sparse_maps_are_refused_until_they_are_completed() {
    let folder = tempfile::tempdir().unwrap();
    let dense: Vec<f32> = distances(4.0, 80.0).into_iter().map(|z| z * 256.0).collect();
    let sparse: Vec<f32> = dense.iter().enumerate().map(|(i, v)| if i % 5 == 0 { *v } else { 0.0 }).collect();
    let stated = Stated { near: Some(Near::Small), depth: None };
    let path = write(folder.path(), "lidar.npy", &sparse);
    assert!(matches!(map::read(&path, stated), Err(SceneError::Corrupt { .. })));
    let nearest = |i: usize| {
        let known = (0..N * N).filter(|k| sparse[*k] > 0.0);
        let apart = |k: usize| (k / N).abs_diff(i / N).pow(2) + (k % N).abs_diff(i % N).pow(2);
        sparse[known.min_by_key(|k| apart(*k)).unwrap()]
    };
    let completed: Vec<f32> = (0..N * N).map(nearest).collect();
    let map = map::read(&write(folder.path(), "lidar.npy", &completed), stated).unwrap();
    assert!(nearness(&map).iter().zip(distances(1.0, 0.0)).all(|(a, b)| (a - b).abs() < 0.35));
}

/// Maps of 8 bits follow the convention of pictures that bright is near. Zeros are values, unless distances are stated.
#[test]
fn eight_bits_are_bright_where_near_and_zeros_follow_the_stated_word() {
    let folder = tempfile::tempdir().unwrap();
    let bytes: Vec<f32> = distances(255.0, 0.0).into_iter().map(f32::round).collect();
    let path = write(folder.path(), "8bit.png", &bytes);
    let read = |near| map::read(&path, Stated { near, depth: None }).unwrap();
    assert_eq!(read(None).meaning, Meaning::Relative(Near::Bright));
    assert_eq!(read(Some(Near::Dark)).values, bytes);
    assert_eq!(read(Some(Near::Bright)).values, bytes);
    // These are a black figure in front of a white ground, and distances with holes.
    let figure: Vec<f32> = (0..N * N).map(|i| if i % N < 5 { 0.0 } else { 255.0 }).collect();
    let path = write(folder.path(), "figure-8bit.png", &figure);
    assert_eq!(map::read(&path, Stated { near: Some(Near::Dark), depth: None }).unwrap().values, figure);
    let holes = with_hole(distances(40.0, 250.0).into_iter().map(f32::round).collect(), 0.0);
    let path = write(folder.path(), "holes-8bit.png", &holes);
    let map = map::read(&path, Stated { near: Some(Near::Small), depth: None }).unwrap();
    assert!(map.values.iter().all(|v| *v >= 40.0));
}
