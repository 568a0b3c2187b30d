//! Tests pictures with maps of every kind. Each is read the right way round, or refused with the line that decides.

use super::{GREEN, display, fails, get, picture_with_map, speckle};
use crate::*;
use image::{ImageBuffer, Luma, Rgb};
use std::{fs, path::PathBuf};

const N: usize = 16;

fn pfm(kind: &str, values: &[f32]) -> Vec<u8> {
    // Rows come from the bottom. The maps here are the same in every row, except for holes.
    let mut bytes = format!("{kind} {N} {} -1\n", values.len() / N / if kind == "PF" { 3 } else { 1 }).into_bytes();
    values.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    bytes
}

fn npy(values: &[f32]) -> Vec<u8> {
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}, {N}), }}", values.len() / N);
    let mut bytes = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    bytes.extend(format!("{header:<117}\n").bytes());
    values.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    bytes
}

/// Returns a map that grows from left to right, with other values in these pixels.
fn ramp(from: f32, to: f32, others: &[(usize, f32)]) -> Vec<f32> {
    let mut values: Vec<f32> = (0..N * N).map(|i| from + (to - from) * (i % N) as f32 / (N - 1) as f32).collect();
    others.iter().for_each(|&(i, v)| values[i] = v);
    values
}

/// Writes a map in the format of its file extension.
fn write(path: &Path, values: &[f32]) {
    let word = |x: u32, y: u32| values[y as usize * N + x as usize];
    let n = N as u32;
    let name = path.to_str().unwrap();
    if name.contains("rgb") {
        let grey = name.contains("gray");
        let pixel = |v: u8| Rgb([v, if grey { v } else { v / 2 }, if grey { v } else { 255 - v }]);
        ImageBuffer::from_fn(n, n, |x, y| pixel(word(x, y) as u8)).save(path).unwrap();
    } else if name.contains("16") {
        ImageBuffer::from_fn(n, n, |x, y| Luma([word(x, y) as u16])).save(path).unwrap();
    } else if name.ends_with("png") {
        ImageBuffer::from_fn(n, n, |x, y| Luma([word(x, y) as u8])).save(path).unwrap();
    } else if name.ends_with("exr") {
        ImageBuffer::from_fn(n, n, |x, y| Rgb([word(x, y); 3])).save(path).unwrap();
    } else if name.ends_with("color.pfm") {
        fs::write(path, pfm("PF", &values.repeat(3))).unwrap();
    } else {
        fs::write(path, if name.ends_with("pfm") { pfm("Pf", values) } else { npy(values) }).unwrap();
    }
}

/// Name of the file, the stated near values, the values, and the side that is near or the text of the line.
type Row = (&'static str, Option<Near>, Vec<f32>, Result<&'static str, &'static str>);

#[test]
fn each_map_is_read_the_right_way_round_or_refused() {
    use Near::{Bright, Dark, Large, Small};
    const RIGHT: Result<&str, &str> = Ok("right");
    const LEFT: Result<&str, &str> = Ok("left");
    let holes = [(3, f32::NAN), (40, f32::INFINITY), (77, 0.0), (78, 0.0)];
    let unknown: Vec<(usize, f32)> = (16..40).map(|i| (i, 0.0)).collect();
    let most: Vec<(usize, f32)> = (0..200).map(|i| (i, f32::NAN)).collect();
    let decides = Err("ambiguous/values");
    let rows: [Row; 26] = [
        ("map.png", None, ramp(0.0, 255.0, &[]), RIGHT),
        ("map.png", Some(Large), ramp(0.0, 255.0, &[]), RIGHT),
        ("map.png", Some(Dark), ramp(0.0, 255.0, &[]), LEFT),
        ("gray-rgb.png", None, ramp(0.0, 255.0, &[]), RIGHT),
        ("gray-rgb.jpg", None, ramp(0.0, 255.0, &[]), RIGHT),
        ("jet-rgb.png", None, ramp(0.0, 255.0, &[]), Err("corrupt/map-colors")),
        ("depth16.png", None, ramp(0.0, 65535.0, &[]), decides),
        ("depth16.png", Some(Dark), ramp(0.0, 65535.0, &[]), LEFT),
        ("depth16.png", Some(Bright), ramp(0.0, 65535.0, &[]), RIGHT),
        ("kinect16.png", None, ramp(500.0, 4200.0, &unknown), decides),
        ("kinect16.png", Some(Small), ramp(500.0, 4200.0, &unknown), LEFT),
        ("disp.pfm", None, ramp(-0.5, 0.5, &[]), RIGHT),
        ("disp.pfm", None, ramp(-0.5, 0.5, &holes), RIGHT),
        ("disp.npy", Some(Small), ramp(-0.5, 0.5, &[]), Err("ambiguous/disparities")),
        ("depth.npy", None, ramp(0.5, 2.0, &[]), LEFT),
        ("depth.npy", Some(Large), ramp(0.5, 2.0, &[]), RIGHT),
        ("view_03_z.pfm", None, ramp(0.5, 2.0, &holes), LEFT),
        ("Distance-1.exr", None, ramp(0.5, 2.0, &[(9, 1e10), (99, 65504.0)]), LEFT),
        ("map.npy", None, ramp(0.5, 2.0, &[]), decides),
        ("map.pfm", None, ramp(0.5, 2.0, &[]), decides),
        ("map.exr", None, ramp(0.5, 2.0, &[]), decides),
        ("inverse_depth.npy", None, ramp(0.5, 2.0, &[]), decides),
        ("map.npy", Some(Small), ramp(0.5, 2.0, &[]), LEFT),
        ("map.npy", Some(Small), ramp(0.5, 2.0, &most), Err("corrupt/map-holes")),
        ("color.pfm", Some(Small), ramp(0.5, 2.0, &[]), Err("corrupt/pfm-color")),
        ("depth.npy", None, ramp(0.5, 2.0, &[])[..N * (N - 1)].to_vec(), Err("15 x 16")),
    ];
    let display = display(N, N);
    let (folder, picture, png) = picture_with_map(16, 16, |y, x| [speckle(y, x); 3], |_, x| (x * 17) as u8);
    let request = Request { views: 3, ..Request::new(&display, &GREEN) };
    let views = |map: &Path, near, depth| {
        get(&picture, &Request { depth_map: Some(map), near, depth, ..request }).planes.remove(0)
    };
    let depth = Some([-0.3e-3, 0.3e-3]);
    let (right, left) = (views(&png, Some(Bright), depth), views(&png, Some(Dark), depth));
    let apart = |a: &[Vec<f32>], b: &[Vec<f32>]| -> f32 {
        a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs()).sum()
    };
    for (name, near, values, wanted) in rows {
        let map = folder.path().join(name);
        write(&map, &values);
        match wanted {
            Ok(side) => {
                let read = views(&map, near, depth);
                let found = if apart(&read, &right) < apart(&read, &left) { "right" } else { "left" };
                assert_eq!(found, side, "{name}, {near:?}");
            }
            Err(line) => {
                let said = fails(&picture, &Request { depth_map: Some(&map), near, depth, ..request });
                assert!(said.contains(name) && said.contains(line) && !said.contains('\n'), "{name}, {near:?}: {said}");
            }
        }
    }
    // The nearer depth first means the same as small, but contradicts its opposite.
    let reversed = Some([0.3e-3, -0.3e-3]);
    assert_eq!(views(&png, None, reversed), left);
    assert_eq!(views(&png, Some(Dark), reversed), left);
    let said = fails(&picture, &Request { depth_map: Some(&png), near: Some(Large), depth: reversed, ..request });
    assert!(said.starts_with("request: "), "{said}");
}

#[test]
fn what_a_map_lacks_comes_from_the_farther_side() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("depth.npy");
    let nan = f32::NAN;
    let mut values = ramp(1.0, 1.0, &[]);
    values[..6].copy_from_slice(&[nan, 5.0, nan, nan, 3.0, nan]);
    values[N..2 * N].fill(nan);
    write(&path, &values);
    for (near, between) in [(Near::Small, 5.0), (Near::Large, 3.0)] {
        let map = depth::map::read(&path, light_field::near::Stated { near: Some(near), depth: None }).unwrap();
        assert_eq!(map.values[..4], [5.0, 5.0, between, between]);
        assert_eq!(map.values[5], if near == Near::Small { 3.0 } else { 1.0 });
        assert_eq!(map.values[N..2 * N], map.values[..N]);
    }
}

#[test]
fn maps_mean_the_depths_that_are_asked_for() {
    let display = display(N, N);
    let (folder, picture, png) = picture_with_map(16, 16, |y, x| [speckle(y, x); 3], |_, x| (x * 17) as u8);
    let request = Request { views: 3, near: Some(Near::Large), ..Request::new(&display, &GREEN) };
    let range = |map: &Path, depth| get(&picture, &Request { depth_map: Some(map), depth, ..request });
    let file = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        path
    };
    let values = ramp(-0.5, 0.5, &[]);
    let [low, high] = range(&file("disp.pfm", &pfm("Pf", &values)), None).disparity.unwrap();
    assert!((low + 0.5).abs() < 1e-6 && (high - 0.5).abs() < 1e-6);
    // Disparities of a stereo pair are too large, until the depths to which they are scaled are stated.
    let stereo = file("disp0.pfm", &pfm("Pf", &ramp(20.0, 60.0, &[(5, f32::INFINITY)])));
    let refused = load(&picture, &Request { depth_map: Some(&stereo), near: None, ..request });
    assert!(matches!(refused, Err(SceneError::Request { .. })));
    let ends = range(&stereo, Some([-0.2e-3, 0.4e-3])).depth.unwrap();
    assert!((ends[0] + 0.2e-3).abs() < 1e-9 && (ends[1] - 0.4e-3).abs() < 1e-9, "{ends:?}");
    let wanted = Some([-0.2e-3, 0.4e-3]);
    let from_png = range(&png, wanted);
    let ends = from_png.depth.unwrap();
    assert!((ends[0] + 0.2e-3).abs() < 1e-9 && (ends[1] - 0.4e-3).abs() < 1e-9, "{ends:?}");
    for other in [file("depth.pfm", &pfm("Pf", &values)), file("depth.npy", &npy(&values))] {
        let field = range(&other, wanted);
        let views = field.planes[0].iter().flatten().zip(from_png.planes[0].iter().flatten());
        assert!(views.fold(0.0f32, |a, (x, y)| a.max((x - y).abs())) < 1e-3, "{}", other.display());
    }
    assert!(fails(&picture, &request).starts_with("no-depth-map: "));
    let refused = |map: &Path, depth| fails(&picture, &Request { depth_map: Some(map), depth, ..request });
    assert!(refused(&folder.path().join("none.png"), None).contains("none.png"));
    assert!(refused(folder.path(), None).starts_with("corrupt/map-folder: "));
    let array = npy(&values);
    assert!(refused(&file("cut.npy", &array[..array.len() - 8]), None).contains("cut.npy"));
    let mut axes = array.clone();
    let shape = axes.windows(11).position(|bytes| bytes == b"(16, 16), }").unwrap();
    axes[shape..shape + 11].copy_from_slice(b"(4,4,16), }");
    assert!(refused(&file("axes.npy", &axes), None).starts_with("corrupt/map-shape: "));
    assert!(refused(&file("long.npy", b"\x93NUMPY\x02\x00\xff\xff\xff\xffxx"), None).starts_with("corrupt/npy-header"));
    assert!(refused(&file("not.npy", b"hello"), None).contains("not.npy"));
    assert!(refused(&png, Some([-0.04, 0.04])).starts_with("request: "));
}

#[test]
fn maps_belong_to_pictures_one_by_one() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for name in ["a.png", "b.pfm", "depth_0007.npy", "depth_0008.npy"] {
        fs::write(at(name), b"").unwrap();
    }
    let pictures = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>();
    let of = |names: &[&str], maps: &[PathBuf]| depth_maps(&pictures(names), maps);
    let all = [folder.path().to_path_buf()];
    assert_eq!(
        of(&["x/b.png", "x/a.jpg", "photo-7.png"], &all),
        Ok(vec![at("b.pfm"), at("a.png"), at("depth_0007.npy")])
    );
    assert_eq!(of(&["x.png", "y.png"], &[at("b"), at("a")]), Ok(vec![at("b"), at("a")]));
    assert_eq!(of(&["x.png"], &[at("a.png")]), Ok(vec![at("a.png")]));
    assert_eq!(of(&["x.png", "x.png"], &[at("a.png")]), Ok(vec![at("a.png"); 2]));
    assert_eq!(of(&["x.png", "y.png"], &[]), Ok(vec![]));
    for (names, maps, said) in [
        (&["x.png", "y.png"][..], vec![at("a.png")], ["a.png", " 2 "]),
        (&["x.png", "y.png", "z.png"], vec![at("a.png"), at("b.pfm")], ["2 ", " 3 "]),
        (&["a.png", "c9.png"], vec![folder.path().into()], ["c9.png", " 0 "]),
    ] {
        let Err(SceneError::Maps { what }) = of(names, &maps) else { panic!("{said:?}: {:?}", of(names, &maps)) };
        assert!(said.iter().all(|part| what.contains(part)), "{said:?}: {what}");
    }
}
