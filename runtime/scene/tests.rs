//! Tests several modules together, with signs, folders, pictures with maps and built-in scenes.

#[path = "cameras_tests.rs"]
mod cameras;
#[path = "drawn_tests.rs"]
mod drawn;
#[path = "generated_tests.rs"]
mod generated;
#[path = "halves_tests.rs"]
mod halves;
#[path = "interpolate_tests.rs"]
mod interpolate;
#[path = "kept_tests.rs"]
mod kept;
#[path = "map_tests.rs"]
mod map;
#[path = "near_tests.rs"]
mod near;
#[path = "orientation_tests.rs"]
mod orientation;
#[path = "profile_tests.rs"]
mod profile;
#[path = "reading_tests.rs"]
mod reading;
#[path = "sequence_tests.rs"]
mod sequence;
#[path = "splat_formats_tests.rs"]
mod splat_formats;
#[path = "splats_tests.rs"]
mod splats;
#[path = "tone_tests.rs"]
mod tone;

use crate::*;
use eyebox_base::error::ErrorData;
use eyebox_optics::{Color, Display};
use image::{ImageBuffer, Luma, Rgb};
use std::{fs, path::PathBuf};

pub(super) const GREEN: [Color; 1] = [Color::Green];
const ALL: [Color; 3] = [Color::Red, Color::Green, Color::Blue];

pub(super) fn display(height: usize, width: usize) -> Display {
    Display { height, width, ..Display::preset("small").unwrap() }
}

pub(super) fn get(source: &str, request: &Request) -> LightField {
    load(source, request).unwrap_or_else(|e| panic!("{source}: {e}"))
}

/// Returns the code and the message of an error.
pub(super) fn coded(error: &SceneError) -> String {
    format!("{}: {error}", ErrorData::of(error).code)
}

pub(super) fn fails(source: &str, request: &Request) -> String {
    match load(source, request) {
        Ok(field) => panic!("{} must be refused", field.name),
        Err(error) => coded(&error),
    }
}

/// Refocuses by shift and add. It averages the views `(r, c)` for which `used` returns true, moved by `(z / f) q`
/// pixels.
fn refocus(field: &LightField, display: &Display, z: f64, used: impl Fn(usize, usize) -> bool) -> Vec<f32> {
    let (h, w) = (field.height as i64, field.width as i64);
    let per_view = z / display.focal_length * field.cell(display) / display.pitch;
    let mut sum = vec![0.0f32; field.height * field.width];
    let mut count = 0.0f32;
    for r in 0..field.grid[0] {
        for c in (0..field.grid[1]).filter(|&c| used(r, c)) {
            let view = &field.planes[0][r * field.grid[1] + c];
            let dy = per_view * (r as f64 - (field.grid[0] as f64 - 1.0) / 2.0);
            let dx = per_view * (c as f64 - (field.grid[1] as f64 - 1.0) / 2.0);
            let at = |y: i64, x: i64| view[(y.clamp(0, h - 1) * w + x.clamp(0, w - 1)) as usize];
            for y in 0..h {
                for x in 0..w {
                    let (sy, sx) = (y as f64 - dy, x as f64 - dx);
                    let (iy, ix) = (sy.floor(), sx.floor());
                    let (ty, tx) = ((sy - iy) as f32, (sx - ix) as f32);
                    let (iy, ix) = (iy as i64, ix as i64);
                    let top = at(iy, ix) * (1.0 - tx) + at(iy, ix + 1) * tx;
                    let below = at(iy + 1, ix) * (1.0 - tx) + at(iy + 1, ix + 1) * tx;
                    sum[(y * w + x) as usize] += top * (1.0 - ty) + below * ty;
                }
            }
            count += 1.0;
        }
    }
    sum.iter_mut().for_each(|v| *v /= count);
    sum
}

/// Returns the mean squared difference over the middle of two pictures.
fn apart(a: &[f32], b: &[f32], height: usize, width: usize) -> f32 {
    let (m, mut sum, mut count) = (12, 0.0, 0.0);
    for y in m..height - m {
        for x in m..width - m {
            sum += (a[y * width + x] - b[y * width + x]).powi(2);
            count += 1.0;
        }
    }
    sum / count
}

/// Checks that the scene is sharp at `z`, on both axes, and neither at 0 nor at -z.
fn is_sharp_at(field: &LightField, display: &Display, z: f64) {
    let (h, w) = (field.height, field.width);
    let [rows, columns] = field.grid;
    let middle = &field.planes[0][rows / 2 * columns + columns / 2];
    for axis in ["x", "y", "both"] {
        let used = |r: usize, c: usize| match axis {
            "x" => r == rows / 2,
            "y" => c == columns / 2,
            _ => true,
        };
        let at = |z: f64| apart(&refocus(field, display, z, used), middle, h, w);
        let (sharp, flat, wrong) = (at(z), at(0.0), at(-z));
        assert!(sharp * 5.0 < flat && sharp * 5.0 < wrong, "{axis}: {sharp} at z, {flat} at 0, {wrong} at -z");
    }
}

#[test]
fn a_rendered_plane_is_sharp_at_its_depth_and_nowhere_else() {
    let display = display(64, 96);
    let request = Request { views: 5, ..Request::new(&display, &GREEN) };
    for depth in [2.0, -3.0] {
        let field = get(&format!("builtin:plane?depth={depth}"), &request);
        assert_eq!((field.grid, field.height, field.width), ([5, 5], 64, 96));
        let [far, near] = field.depth_range(&display).unwrap();
        assert!((far - depth * 1e-3).abs() < 1e-9 && (near - far).abs() < 1e-12);
        let per_pixel = display.focal_length * display.pitch / field.cell(&display);
        assert!((field.disparity.unwrap()[0] * per_pixel - far).abs() < 1e-9);
        is_sharp_at(&field, &display, depth * 1e-3);
    }
}

#[test]
fn a_stated_view_pitch_changes_disparities_not_depths() {
    let display = display(64, 96);
    let request = Request { views: 5, view_pitch: Some(3e-3), ..Request::new(&display, &GREEN) };
    let field = get("builtin:plane?depth=2", &request);
    assert_eq!(field.cell(&display), 3e-3);
    is_sharp_at(&field, &display, 2e-3);
    let far_apart = Request { view_pitch: Some(10.0), ..request };
    assert!(fails("builtin:plane?depth=2", &far_apart).starts_with("optics/unusual: "));
}

#[test]
fn every_built_in_scene_is_light_at_every_size() {
    for (height, width) in [(1, 1), (7, 13), (45, 64), (90, 60)] {
        let display = display(height, width);
        let request = Request { views: 3, ..Request::new(&display, &ALL) };
        for scene in BUILTINS {
            let field = get(&format!("builtin:{}", scene.name), &request);
            assert_eq!((field.planes.len(), field.planes[0].len(), field.planes[0][0].len()), (3, 9, height * width));
            let good = |v: &f32| v.is_finite() && (0.0..2.0).contains(v);
            assert!(field.planes.iter().flatten().flatten().all(good), "{} at {height}x{width}", scene.name);
            let [far, near] = field.depth.unwrap();
            assert!(far.is_finite() && far <= near, "{}: {far} {near}", scene.name);
        }
    }
}

#[test]
fn one_colour_is_the_same_as_in_the_whole_picture_and_every_time() {
    let display = display(48, 64);
    let all = get("builtin:still-life", &Request { views: 2, ..Request::new(&display, &ALL) });
    for color in ALL {
        let one = get("builtin:still-life", &Request { views: 2, ..Request::new(&display, &[color]) });
        assert_eq!(one.planes[0], all.planes[color.channel()], "{color}");
    }
}

#[test]
fn parallax_is_the_same_share_of_the_picture_at_every_size() {
    let total = |size: usize, views: usize| {
        let display = display(size, size);
        let field = get("builtin:still-life", &Request { views, ..Request::new(&display, &GREEN) });
        field.disparity.unwrap().map(|d| d * views as f64 / size as f64)
    };
    let (small, large) = (total(32, 3), total(96, 4));
    assert!((small[1] - large[1]).abs() < 1e-3 && (small[0] - large[0]).abs() < 1e-3, "{small:?} {large:?}");
    let paper = Display { height: 512, width: 512, ..Display::preset("paper").unwrap() };
    assert!((builtin::half_span(&paper) - 3e-3).abs() < 1e-12);
}

#[test]
fn dark_and_bright_are_and_brightness_multiplies() {
    let display = display(64, 64);
    let request = Request { views: 1, ..Request::new(&display, &GREEN) };
    let mean = |scene: &str| {
        let view = &get(&format!("builtin:{scene}"), &request).planes[0][0];
        view.iter().sum::<f32>() / view.len() as f32
    };
    let usual = mean("still-life");
    assert!(mean("still-life-dark") < usual / 3.0 && mean("still-life-bright") > usual * 2.0);
    assert!((mean("still-life?brightness=0.5") - usual / 2.0).abs() < 1e-4);
}

#[test]
fn built_in_names_and_parameters_are_checked() {
    let display = display(8, 8);
    let request = Request::new(&display, &GREEN);
    assert!(fails("builtin:stil-life", &request).starts_with("builtin/no-such-scene: "));
    for bad in [
        "plane?depth",
        "plane?depth=x",
        "plane?depth=inf",
        "chart?depth=1",
        "plane?brightness=0",
        "plane?span=-1",
        "plane?camera=1e5",
        "plane?x=1",
    ] {
        assert!(fails(&format!("builtin:{bad}"), &request).contains(bad), "{bad}");
    }
    let twice = [Color::Red, Color::Red];
    for bad in [
        Request { views: 0, ..request },
        Request { views: 65, ..request },
        Request { view_pitch: Some(0.0), ..request },
        Request { view_pitch: Some(f64::NAN), ..request },
        Request { depth: Some([0.0, f64::INFINITY]), ..request },
        Request { colors: &[], ..request },
        Request { colors: &twice, ..request },
        Request { depth_map: Some(Path::new("m.png")), ..request },
    ] {
        assert!(matches!(load("builtin:plane", &bad), Err(SceneError::Request { .. })), "{bad:?}");
    }
}

/// A camera moved to the right by the distance of one view sees in each view the content of the next one to the right.
#[test]
fn a_camera_that_stands_aside_sees_the_neighbouring_views() {
    let display = display(64, 64);
    let request = Request { views: 3, view_pitch: Some(4e-3), ..Request::new(&display, &GREEN) };
    let (here, aside) =
        (load("builtin:still-life", &request).unwrap(), load("builtin:still-life?camera=4", &request).unwrap());
    let apart = |a: usize, b: usize| {
        let (a, b) = (&aside.planes[0][a], &here.planes[0][b]);
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f32>() / a.len() as f32
    };
    for (row, column) in (0..3).flat_map(|r| (0..2).map(move |c| (r, c))) {
        let view = 3 * row + column;
        // Textures are made on grids with other origins because margins differ.
        assert!(apart(view, view + 1) < 4e-3, "{view}: {}", apart(view, view + 1));
        assert!(apart(view, view) > 2.0 * apart(view, view + 1), "{view}: {}", apart(view, view));
    }
    assert_eq!((aside.depth, aside.disparity), (here.depth, here.disparity));
    let error = fails("builtin:still-life?camera=2000", &request);
    assert!(error.starts_with("request: "), "{error}");
}

// These tests are for folders.

fn write_view(path: PathBuf, height: u32, width: u32, level: u8) {
    ImageBuffer::from_fn(width, height, |x, _| Rgb([level, x as u8, 255])).save(path).unwrap();
}

fn folder_of(rows: usize, columns: usize, name: impl Fn(usize, usize) -> String) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for r in 0..rows {
        for c in 0..columns {
            write_view(folder.path().join(name(r, c)), 6, 8, (r * columns + c) as u8);
        }
    }
    folder
}

#[test]
fn a_folder_of_views_is_read_in_order_and_in_linear_light() {
    let display = display(6, 8);
    let request = Request::new(&display, &[Color::Red, Color::Blue]);
    let folder = folder_of(3, 3, |r, c| format!("input_Cam{:03}.png", r * 3 + c));
    write_view(folder.path().join("thumbnail.png"), 2, 2, 9);
    fs::write(
        folder.path().join("parameters.cfg"),
        "[meta]\nnum_cams_x = 3\nnum_cams_y = 3\ndisp_min = -1.5\ndisp_max = 2\n",
    )
    .unwrap();
    let field = get(folder.path().to_str().unwrap(), &request);
    assert_eq!((field.grid, field.height, field.width), ([3, 3], 6, 8));
    assert_eq!(field.disparity, Some([-1.5, 2.0]));
    for (v, view) in field.planes[0].iter().enumerate() {
        let light = srgb_to_linear(v as f64 / 255.0) as f32;
        assert!(view.iter().all(|&p| (p - light).abs() < 1e-7), "view {v}");
    }
    assert!(field.planes[1].iter().flatten().all(|&p| p == 1.0));

    // The TOML file takes precedence, and stated lengths scale with the picture.
    fs::write(folder.path().join("lightfield.toml"), "view_pitch_mm = 2\ndisparity = [-1, 1]\ntransfer = \"linear\"\n")
        .unwrap();
    let wide = self::display(12, 20);
    let field = get(folder.path().to_str().unwrap(), &Request { display: &wide, ..request });
    assert_eq!((field.view_pitch, field.disparity), (Some(2e-3), Some([-2.0, 2.0])));
    assert!((field.planes[0][8][6 * 20 + 10] - 8.0 / 255.0).abs() < 1e-6);
    assert_eq!(field.planes[0][8][6 * 20], 0.0, "letterbox");
    let pitch = Request { view_pitch: Some(1e-3), ..request };
    assert_eq!(get(folder.path().to_str().unwrap(), &pitch).cell(&display), 1e-3);
    fs::write(folder.path().join("lightfield.toml"), "view_pitch = 2\n").unwrap();
    let error = fails(folder.path().to_str().unwrap(), &request);
    assert!(error.contains("lightfield.toml") && error.contains("line 1") && error.contains("view_pitch"), "{error}");
}

#[test]
fn rows_and_columns_16_bits_grey_and_a_disparity_map_beside_them() {
    let display = display(4, 5);
    let request = Request::new(&display, &GREEN);
    let folder = tempfile::tempdir().unwrap();
    for (r, c) in [(3, 1), (3, 2), (3, 3), (4, 1), (4, 2), (4, 3)] {
        let view = ImageBuffer::from_pixel(5, 4, Luma([(r * 10000 + c) as u16]));
        view.save(folder.path().join(format!("2067_{r:02}_{c:02}.png"))).unwrap();
    }
    let mut map = b"Pf\n5 4\n-1\n".to_vec();
    (0..20).for_each(|i| map.extend((i as f32 / 10.0 - 0.5).to_le_bytes()));
    fs::write(folder.path().join("gt_disp_lowres.pfm"), &map).unwrap();
    let field = get(folder.path().to_str().unwrap(), &request);
    assert_eq!(field.grid, [2, 3]);
    assert_eq!(field.planes[0][4][0], srgb_to_linear(40002.0 / 65535.0) as f32);
    let [low, high] = field.disparity.unwrap();
    assert!((low + 0.5).abs() < 1e-6 && (high - 1.4).abs() < 1e-6);
    fs::write(folder.path().join("gt_disp_lowres.pfm"), &map[..40]).unwrap();
    assert!(fails(folder.path().to_str().unwrap(), &request).contains("gt_disp_lowres.pfm"));
}

#[test]
fn what_is_wrong_with_a_folder_names_the_file() {
    let display = display(6, 8);
    let request = Request::new(&display, &GREEN);
    let error = fails("/no/such/folder", &request);
    assert!(error.starts_with("not-found: ") && error.contains("/no/such/folder"), "{error}");
    let folder = folder_of(2, 3, |r, c| format!("LF_{r}_{c}.png"));
    let path = folder.path().to_str().unwrap();
    let view = |r, c| folder.path().join(format!("LF_{r}_{c}.png"));

    fs::remove_file(view(1, 1)).unwrap();
    assert!(fails(path, &request).starts_with("missing-view: "));
    write_view(view(1, 1), 6, 9, 0);
    let error = fails(path, &request);
    assert!(error.contains("LF_1_1.png") && error.contains("6 x 9") && error.contains("6 x 8"), "{error}");
    write_view(view(1, 1), 6, 8, 0);
    assert!(load(path, &request).is_ok());

    let whole = fs::read(view(0, 2)).unwrap();
    for length in [0, 4, 20, whole.len() / 2, whole.len() - 20] {
        fs::write(view(0, 2), &whole[..length]).unwrap();
        assert!(fails(path, &request).contains("LF_0_2.png"), "cut to {length} of {}", whole.len());
    }
    let empty = tempfile::tempdir().unwrap();
    assert!(fails(empty.path().to_str().unwrap(), &request).starts_with("empty: "));
    let map = Request { depth_map: Some(Path::new("m.png")), ..request };
    assert!(fails(path, &map).starts_with("request: "));
}

#[test]
fn a_truncated_jpeg_is_refused() {
    let display = display(64, 64);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v_0_0.jpg");
    ImageBuffer::from_fn(64, 64, |x, y| Rgb([(x * 4) as u8, (y * 4) as u8, (x * y) as u8])).save(&path).unwrap();
    let request = Request::new(&display, &GREEN);
    assert!(load(folder.path().to_str().unwrap(), &request).is_ok());
    let whole = fs::read(&path).unwrap();
    fs::write(&path, &whole[..whole.len() * 2 / 3]).unwrap();
    assert!(fails(folder.path().to_str().unwrap(), &request).contains("v_0_0.jpg"));
}

#[test]
fn exr_is_linear_light_and_must_be_light() {
    let display = display(3, 4);
    let request = Request::new(&display, &ALL);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("view_0_0.exr");
    let save = |value: f32| {
        let mut view = ImageBuffer::from_pixel(4, 3, Rgb([0.25f32, 1.5, 0.0]));
        view.put_pixel(1, 2, Rgb([0.25, value, 0.0]));
        view.save(&path).unwrap();
    };
    save(7.0);
    assert!(matches!(load(folder.path().to_str().unwrap(), &request), Err(SceneError::FullScale { .. })));
    fs::write(folder.path().join("lightfield.toml"), "full_scale = 8\n").unwrap();
    let field = get(folder.path().to_str().unwrap(), &request);
    assert_eq!(
        (field.planes[0][0][0], field.planes[1][0][0], field.planes[1][0][9]),
        (0.25 / 8.0, 1.5 / 8.0, 7.0 / 8.0)
    );
    fs::remove_file(folder.path().join("lightfield.toml")).unwrap();
    for bad in [f32::NAN, f32::INFINITY, -0.1] {
        save(bad);
        let error = load(folder.path().to_str().unwrap(), &request).unwrap_err();
        assert!(error.to_string().contains("view_0_0.exr"), "{error}");
        assert!(matches!(error, SceneError::Value { row: 2, column: 1, .. }), "{error}");
    }
}

// These tests are for pictures with a map.

/// Writes a picture and its map to a folder. `color` and `depth` are functions of (row, column), and depth is 0..=255.
pub(super) fn picture_with_map(
    height: u32,
    width: u32,
    color: impl Fn(u32, u32) -> [u8; 3],
    depth: impl Fn(u32, u32) -> u8,
) -> (tempfile::TempDir, String, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let (picture, map) = (folder.path().join("picture.png"), folder.path().join("depth.png"));
    ImageBuffer::from_fn(width, height, |x, y| Rgb(color(y, x))).save(&picture).unwrap();
    ImageBuffer::from_fn(width, height, |x, y| Luma([depth(y, x)])).save(&map).unwrap();
    (folder, picture.display().to_string(), map)
}

pub(super) fn speckle(y: u32, x: u32) -> u8 {
    (((x / 2).wrapping_mul(73) ^ (y / 2).wrapping_mul(151)).wrapping_mul(2_654_435_761) >> 24) as u8
}

#[test]
fn a_reprojected_plane_is_sharp_at_its_depth_and_nowhere_else() {
    let display = display(64, 96);
    let (_folder, picture, map) = picture_with_map(64, 96, |y, x| [speckle(y, x); 3], |_, _| 128);
    for z in [2e-3, -1.5e-3] {
        let request =
            Request { views: 5, depth_map: Some(&map), depth: Some([z, z]), ..Request::new(&display, &GREEN) };
        let field = get(&picture, &request);
        assert!((field.depth_range(&display).unwrap()[0] - z).abs() < 1e-8);
        is_sharp_at(&field, &display, z);
    }
}

#[test]
fn the_near_covers_the_far_and_uncovers_background_not_itself() {
    let (h, w) = (60u32, 80u32);
    let inside = |y: u32, x: u32| (20..40).contains(&y) && (30..50).contains(&x);
    // A red square is in front of a green and blue ground.
    let color = |y: u32, x: u32| if inside(y, x) { [255, 0, 0] } else { [0, speckle(y, x), 200] };
    let (_folder, picture, map) = picture_with_map(h, w, color, |y, x| if inside(y, x) { 255 } else { 0 });
    let display = display(60, 80);
    let cell = display.eyebox_min() / 3.0;
    let depth = |pixels: f64| pixels * display.focal_length * display.pitch / cell;
    // The square moves by 4 pixels from view to view, and the ground by -3.
    let request = Request {
        views: 3,
        depth_map: Some(&map),
        depth: Some([depth(-3.0), depth(4.0)]),
        ..Request::new(&display, &ALL)
    };
    let field = get(&picture, &request);
    let disparity = field.disparity.unwrap();
    assert!((disparity[0] + 3.0).abs() < 1e-4 && (disparity[1] - 4.0).abs() < 1e-4, "{disparity:?}");
    for r in 0..3i64 {
        for c in 0..3i64 {
            let view = (r * 3 + c) as usize;
            let (dy, dx) = (-4 * (r - 1), -4 * (c - 1));
            for y in 0..h as i64 {
                for x in 0..w as i64 {
                    let p = (y * 80 + x) as usize;
                    let [red, blue] = [0, 2].map(|k| field.planes[k][view][p]);
                    let square = inside((y - dy).max(0) as u32, (x - dx).max(0) as u32);
                    let (want_red, want_blue) =
                        if square { (1.0, 0.0) } else { (0.0, srgb_to_linear(200.0 / 255.0) as f32) };
                    let off = (red - want_red).abs().max((blue - want_blue).abs());
                    assert!(off < 2e-2, "view {r},{c} at {y},{x}: red {red}, blue {blue}");
                }
            }
        }
    }
    // The ground moved in the other direction. Away from frame and square, it is the shifted picture.
    let (corner, centre) = (&field.planes[1][0], &field.planes[1][4]);
    for y in 45..54usize {
        for x in 5..70usize {
            assert!((corner[y * 80 + x] - centre[(y + 3) * 80 + x + 3]).abs() < 1e-2, "{y},{x}");
        }
    }
    // Left of the square in the last column, the uncovered part has the texture of the ground and not one smeared
    // color.
    let uncovered: Vec<f32> = (22..38).map(|y| field.planes[1][5][y * 80 + 48]).collect();
    let (low, high) = uncovered.iter().fold((1.0f32, 0.0f32), |(a, b), &v| (a.min(v), b.max(v)));
    assert!(high - low > 0.1, "{uncovered:?}");
}

#[test]
fn a_slanted_surface_has_no_cracks() {
    let (_folder, picture, map) = picture_with_map(64, 64, |_, _| [255; 3], |y, x| (2 * x + 2 * y) as u8);
    let display = display(64, 64);
    let request = Request { views: 5, depth_map: Some(&map), ..Request::new(&display, &GREEN) };
    let field = get(&picture, &request);
    let darkest = field.planes[0].iter().flatten().fold(1.0f32, |a, &v| a.min(v));
    assert!(darkest > 0.999, "{darkest}");
    assert!((field.depth.unwrap()[1] - builtin::half_span(&display)).abs() < 1e-8);
}
