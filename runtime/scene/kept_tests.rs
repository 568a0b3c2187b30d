//! Tests light fields in one file, which are arrays and pictures of many views. Each is read correctly or refused with
//! a line that helps.

use super::coded;
use crate::*;
use eyebox_base::files::{linear_to_srgb, npy_header};
use eyebox_optics::{Color, Display};
use image::{ImageBuffer, Rgb};
use std::{fs, path::PathBuf};

const ALL: [Color; 3] = [Color::Red, Color::Green, Color::Blue];

fn display(size: usize) -> Display {
    Display { height: size, width: size, ..Display::preset("small").unwrap() }
}

fn render(views: usize, size: usize) -> LightField {
    let display = display(size);
    load("builtin:still-life?span=1.1", &Request { views, ..Request::new(&display, &ALL) }).unwrap()
}

/// Returns (rows of views, columns, rows of pixels, columns, colors), at most full scale.
fn interleaved(field: &LightField) -> Vec<f32> {
    let (views, pixels) = (field.planes[0].len(), field.planes[0][0].len());
    let value = |i: usize| field.planes[i % 3][i / 3 / pixels][i / 3 % pixels].min(1.0);
    (0..views * pixels * 3).map(value).collect()
}

/// Converts values to this kind of element, little-endian, with integers by the sRGB curve.
fn bytes(kind: &str, values: impl Iterator<Item = f32>) -> Vec<u8> {
    let level = |v: f32, full: f64| (linear_to_srgb(f64::from(v)) * full).round();
    let one = |v: f32| match kind {
        "|u1" => vec![level(v, 255.0) as u8],
        "<u2" => (level(v, 65535.0) as u16).to_le_bytes().to_vec(),
        "<f2" => half::f16::from_f32(v).to_le_bytes().to_vec(),
        "<f4" => v.to_le_bytes().to_vec(),
        _ => f64::from(v).to_le_bytes().to_vec(),
    };
    values.flat_map(one).collect()
}

fn write(file: &Path, kind: &str, shape: &[usize], values: &[f32]) {
    let mut all = npy_header(kind, shape);
    all.extend(bytes(kind, values.iter().copied()));
    fs::write(file, all).unwrap();
}

fn green(source: &str, size: usize) -> Result<LightField, String> {
    load(source, &Request::new(&display(size), &[Color::Green])).map_err(|error| coded(&error))
}

/// Returns the numbers in a text.
fn numbers(text: &str) -> Vec<f64> {
    let words = text.split(|c: char| !c.is_ascii_digit() && c != '.');
    words.filter_map(|word| word.parse().ok()).collect()
}

/// Returns the largest difference between two fields' views in one color.
fn apart(a: &LightField, b: &LightField, color: [usize; 2]) -> f32 {
    assert_eq!((a.grid, a.height, a.width), (b.grid, b.height, b.width));
    let pairs = a.planes[color[0]].iter().flatten().zip(b.planes[color[1]].iter().flatten());
    pairs.map(|(a, b)| (a - b.min(1.0)).abs()).fold(0.0, f32::max)
}

#[test]
fn arrays_of_every_kind_are_read() {
    let (here, truth) = (tempfile::tempdir().unwrap(), render(3, 32));
    let (values, shape) = (interleaved(&truth), [3, 3, 32, 32, 3]);
    let file = here.path().join("views.npy");
    let name = file.to_str().unwrap();
    for (kind, off) in [("|u1", 6e-3), ("<u2", 1e-4), ("<f2", 1e-3), ("<f4", 0.0), ("<f8", 1e-7)] {
        write(&file, kind, &shape, &values);
        let read = load(name, &Request::new(&display(32), &ALL)).unwrap();
        (0..3).for_each(|c| assert!(apart(&read, &truth, [c, c]) <= off, "{kind}: {}", apart(&read, &truth, [c, c])));
        assert_eq!((&read.name[..], native_size(name).unwrap()), ("views.npy", Some([32, 32])));
        // The other curve counts if it is stated.
        let other = if kind.contains('u') { "linear" } else { "srgb" };
        let read = green(&format!("{name}?{other}"), 32).unwrap();
        assert!(apart(&read, &truth, [0, 1]) > 0.1, "{kind} as {other}");
    }
    // This part tests Fortran order.
    let at = |i: usize| {
        let (mut rest, mut index) = (i, [0; 5]);
        shape.iter().zip(&mut index).for_each(|(n, k)| (*k, rest) = (rest % n, rest / n));
        index.iter().zip(shape).fold(0, |at, (k, n)| at * n + k)
    };
    let header = String::from_utf8(npy_header("<f4", &shape)[10..].to_vec()).unwrap().replace("False", "True ");
    let start = [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes()].concat();
    fs::write(&file, [start, bytes("<f4", (0..values.len()).map(|i| values[at(i)]))].concat()).unwrap();
    assert_eq!(apart(&green(name, 32).unwrap(), &truth, [0, 1]), 0.0);
    // These are gray views, and views one after the other.
    let grey: Vec<f32> = values.chunks_exact(3).map(|pixel| pixel[1]).collect();
    write(&file, "<f4", &shape[..4], &grey);
    assert_eq!(apart(&green(name, 32).unwrap(), &truth, [0, 1]), 0.0);
    write(&file, "<f4", &[9, 32, 32, 3], &values);
    assert_eq!(apart(&green(&format!("{name}?grid=3x3"), 32).unwrap(), &truth, [0, 1]), 0.0);
    // The settings in the same folder count, unless they are for other files.
    fs::write(here.path().join("lightfield.toml"), "grid = [3, 3]\ndepth_mm = [-2, 3]\nview_pitch_mm = 2.5").unwrap();
    let read = green(name, 32).unwrap();
    assert_eq!((read.depth, read.view_pitch), (Some([-2e-3, 3e-3]), Some(2.5e-3)));
    fs::write(here.path().join("lightfield.toml"), "files = \"v_*.png\"\ngrid = [9, 9]\nkeep = [3, 3]").unwrap();
    assert_eq!(green(&format!("{name}?grid=3x3"), 32).unwrap().depth, None);
    fs::write(here.path().join("lightfield.toml"), "grid = [3, 3]\nkeep = [1, 1]").unwrap();
    assert_eq!(green(name, 32).unwrap().planes[0], [truth.planes[1][4].iter().map(|v| v.min(1.0)).collect::<Vec<_>>()]);
}

#[test]
fn what_an_array_lacks_is_asked_for() {
    let here = tempfile::tempdir().unwrap();
    let file = here.path().join("views.npy");
    let name = file.to_str().unwrap().to_owned();
    let says = |kind: &str, shape: &[usize], values: &[f32], query: &str, what: &str| {
        let count = shape.iter().product::<usize>();
        let values: Vec<f32> = values.iter().copied().chain(std::iter::repeat(0.5)).take(count).collect();
        write(&file, kind, shape, &values);
        let line = green(&format!("{name}{query}"), 16).unwrap_err();
        assert!(line.contains(what) && !line.contains('\n'), "{line}");
    };
    says("<f4", &[9, 8, 8, 3], &[], "", "corrupt/array-row-of-views");
    says("<f4", &[10, 8, 8], &[], "", "views.npy?grid=2x5");
    says("<f4", &[3, 3, 3, 8, 8], &[], "", "numpy.moveaxis(views, 2, -1)");
    says("<f4", &[3, 3, 8, 8, 2], &[], "", "corrupt/array-shape");
    says("<f4", &[3, 3, 8, 8, 3], &[], "?grid=2x3", "corrupt/grid-count");
    says("<f4", &[3, 3, 8, 8, 3], &[], "?grid=99x1", "options/option-value");
    says("<f4", &[3, 3, 8, 8, 3], &[], "?mosaic", "options/option");
    says("<f4", &[3, 3, 8, 0, 3], &[], "", "corrupt/array-size");
    says("<f4", &[3, 3, 8, 8], &[0.5, 0.5, f32::NAN], "", "value: ");
    let error = load(&name, &Request::new(&display(16), &[Color::Green])).unwrap_err();
    let SceneError::Value { file: view, row: 0, column: 2, .. } = &error else { panic!("{error}") };
    assert!(numbers(view).ends_with(&[1.0, 1.0]), "{error}");
    says("<f4", &[65, 1, 1, 1], &[], "", "corrupt/array-size");
    fs::write(&file, [npy_header("<i8", &[1, 2, 1, 1]), vec![0; 16]].concat()).unwrap();
    assert!(green(&name, 16).unwrap_err().contains("astype('uint8')"));
    assert!(green(&format!("{name}s"), 16).unwrap_err().starts_with("not-found: "));
    let folder = format!("{}?grid=9x9", here.path().display());
    assert!(green(&folder, 16).unwrap_err().contains("lightfield.toml"));
    fs::write(here.path().join("lightfield.toml"), "keep = [2, 1]").unwrap();
    says("<f4", &[3, 3, 8, 8], &[], "", "settings/keep");
}

/// Writes the views as one picture, next to each other or with a pixel of each under each lens.
fn mosaic(folder: &Path, field: &LightField, lenslets: bool) -> PathBuf {
    let ([rows, columns], h, w) = (field.grid, field.height, field.width);
    let file = folder.join(if lenslets { "lenslets.png" } else { "tiles.png" });
    let pixel = |x: u32, y: u32| {
        let (x, y) = (x as usize, y as usize);
        let (view, at) = if lenslets {
            (y % rows * columns + x % columns, y / rows * w + x / columns)
        } else {
            (y / h * columns + x / w, y % h * w + x % w)
        };
        Rgb([0, 1, 2].map(|c| (linear_to_srgb(f64::from(field.planes[c][view][at])) * 255.0).round() as u8))
    };
    ImageBuffer::from_fn((w * columns) as u32, (h * rows) as u32, pixel).save(&file).unwrap();
    file
}

#[test]
fn pictures_of_many_views_are_read_with_their_grid_stated_or_found() {
    let (here, truth) = (tempfile::tempdir().unwrap(), render(5, 64));
    for (lenslets, found, stated) in [(false, "?mosaic", "?grid=5x5"), (true, "?lenslets", "?lenslets&grid=5x5&srgb")] {
        let file = mosaic(here.path(), &truth, lenslets);
        let name = file.to_str().unwrap();
        for query in [found, stated] {
            let source = format!("{name}{query}");
            let read = green(&source, 64).unwrap();
            assert!(apart(&read, &truth, [0, 1]) < 6e-3, "{query}: {}", apart(&read, &truth, [0, 1]));
            assert_eq!(native_size(&source).unwrap(), Some([64, 64]), "{query}");
        }
        let line = green(&format!("{name}?grid=7x5"), 64).unwrap_err();
        assert!(line.contains("320 x 320"), "{line}");
        assert!(green(&format!("{name}?linear"), 64).unwrap_err().starts_with("no-depth-map: "));
    }
    // This picture shows no grid.
    let file = here.path().join("plain.png");
    ImageBuffer::from_pixel(64, 64, Rgb([90u8, 90, 90])).save(&file).unwrap();
    let line = green(&format!("{}?grid=9x7", file.display()), 64).unwrap_err();
    assert!(line.contains("63 x 63"), "{line}");
    let line = green(&format!("{}?grid=64x60&lenslets", mosaic(here.path(), &render(1, 20), true).display()), 64);
    assert!(line.as_ref().unwrap_err().contains("64 x 60"), "{line:?}");
    for query in ["mosaic", "lenslets"] {
        let line = green(&format!("{}?{query}", file.display()), 64).unwrap_err();
        assert!(line.starts_with("not-a-grid/mosaic-no-grid: ") && line.contains("grid=9x9"), "{line}");
    }
}

/// A picture of views with dark borders has no seams, and a scaled picture has no whole views. A single view with an
/// edge in its middle is not two views.
#[test]
fn a_picture_of_many_views_is_known_by_what_repeats() {
    let (here, truth) = (tempfile::tempdir().unwrap(), render(5, 64));
    let whole = image::open(mosaic(here.path(), &truth, false)).unwrap().into_rgb8();
    let read = |name: &str, picture: &image::RgbImage| {
        let file = here.path().join(name);
        picture.save(&file).unwrap();
        green(&format!("{}?mosaic", file.display()), 64)
    };
    let mut framed = whole.clone();
    for (x, y, pixel) in framed.enumerate_pixels_mut() {
        if [x, y].iter().any(|at| !(4..60).contains(&(at % 64))) {
            *pixel = Rgb([0, 0, 0]);
        }
    }
    assert_eq!(read("framed.png", &framed).unwrap().grid, [5, 5]);
    let scaled = image::imageops::thumbnail(&whole, 317, 318);
    let line = read("scaled.png", &scaled).unwrap_err();
    assert!(line.starts_with("corrupt/mosaic-size: "), "{line}");
    assert!(["5 x 5", "318 x 317", "320 x 315"].iter().all(|part| line.contains(part)), "{line}");
    let nine = image::open(mosaic(here.path(), &render(9, 32), false)).unwrap().into_rgb8();
    let line = read("nine.png", &image::imageops::thumbnail(&nine, 288, 291)).unwrap_err();
    assert!(line.contains("9 x 9") && line.contains("291 x 288"), "{line}");
    let mut single = image::imageops::crop_imm(&whole, 0, 0, 64, 64).to_image();
    for (x, _, pixel) in single.enumerate_pixels_mut() {
        pixel.0 = pixel.0.map(|v| if x < 32 { v } else { v / 2 + 128 });
    }
    let line = read("single.png", &single).unwrap_err();
    assert!(line.starts_with("not-a-grid/mosaic-no-grid: "), "{line}");
}

/// An order that the pictures contradict, a mirrored axis, a view of another exposure and a view of another size are
/// each refused in one line with the likely cause.
#[test]
fn wrong_light_fields_are_found_however_they_are_kept() {
    let (here, truth) = (tempfile::tempdir().unwrap(), render(5, 96));
    let spoiled = |spoil: &dyn Fn(&mut Vec<Vec<f32>>)| {
        let mut field = truth.clone();
        field.planes.iter_mut().for_each(spoil);
        field
    };
    let places = |at: &dyn Fn(usize, usize) -> usize| (0..25).map(|v| at(v / 5, v % 5)).collect::<Vec<_>>();
    let moved = |places: Vec<usize>| spoiled(&|views| *views = places.iter().map(|v| views[*v].clone()).collect());
    let cases = [
        ("columns before rows", moved(places(&|r, c| c * 5 + r)), Err("`order` transpose")),
        ("mirrored columns", moved(places(&|r, c| r * 5 + 4 - c)), Err("`order` flip-columns")),
        ("mirrored rows", moved(places(&|r, c| (4 - r) * 5 + c)), Err("`order` flip-rows")),
        ("near is far", moved(places(&|r, c| (4 - r) * 5 + 4 - c)), Err("`order` flip-rows,flip-columns")),
        // These are row and column of each odd view, and the brightness of one.
        (
            "a view darker than the others",
            spoiled(&|views| views[7].iter_mut().for_each(|v| *v *= 0.6)),
            Ok((vec![2.0, 3.0], vec![0.6])),
        ),
        ("two views exchanged", spoiled(&|views| views.swap(6, 18)), Ok((vec![2.0, 2.0, 4.0, 4.0], vec![]))),
    ];
    for (what, field, wanted) in cases {
        let check = |error: SceneError| {
            let line = error.to_string();
            assert!(!line.contains('\n'), "{what}: {line}");
            match (&error, &wanted) {
                (SceneError::OddViews { views, cause, .. }, Ok(found)) => {
                    assert_eq!((numbers(views), numbers(cause)), *found, "{what}: {line}");
                }
                (_, Err(order)) => assert!(line.contains(order), "{what}: {line}"),
                _ => panic!("{what}: {line}"),
            }
        };
        let array = here.path().join("views.npy");
        write(&array, "|u1", &[5, 5, 96, 96, 3], &interleaved(&field));
        let picture = format!("{}?grid=5x5", mosaic(here.path(), &field, false).display());
        let array = array.to_str().unwrap();
        let display = display(96);
        let request = Request { photographs: ViewSynthesis::Auto, ..Request::new(&display, &[Color::Green]) };
        check(load(array, &request).map(|_| ()).unwrap_err());
        if what == "mirrored rows" || what.contains("darker") {
            check(load(&picture, &request).map(|_| ()).unwrap_err());
            let doubt = inspect(array, &request).unwrap().0.doubt;
            assert!(
                doubt.is_some_and(|doubt| wanted.as_ref().err().is_none_or(|order| doubt.contains(order))),
                "{what}"
            );
        }
    }
    let folder = here.path().join("views");
    fs::create_dir(&folder).unwrap();
    for i in 0..9u32 {
        ImageBuffer::from_pixel(8 + u32::from(i == 4), 8, Rgb([i as u8; 3]))
            .save(folder.join(format!("{i}.png")))
            .unwrap();
    }
    let line = green(folder.to_str().unwrap(), 16).unwrap_err();
    assert!(
        line.starts_with("size: ") && ["4.png", "8 x 9", "0.png", "8 x 8"].iter().all(|part| line.contains(part)),
        "{line}"
    );
}
