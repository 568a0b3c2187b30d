//! Parsers with damaged bytes return an error or a result. They never panic, and a result never holds NaN.
//!
//! Each subject starts from valid files. Proptest damages them, and shrinks a fault to a small number of edits. A short
//! run is part of the tests. `EYEBOX_FUZZ_SECONDS=3600 cargo test --release -p eyebox-tests --test library fuzz::` runs
//! each subject for that time on its own thread, with new seeds each time.

mod content;
mod splats;

use eyebox::low_level::gaze::{Estimator, EyeVelocity, Settings};
use eyebox::low_level::hologram::{self, ColorHologram, Hologram};
use eyebox::low_level::optics::{Color, Display, Optics, Pupil, WindowFactor};
use eyebox::low_level::plan::{Comparison, Planner, ViewLayout};
use eyebox::low_level::scene::{self, Pyramid, Request, ViewGrid};
use eyebox::low_level::trackers::{Sample, line};
use proptest::prelude::*;
use proptest::test_runner::{Config, TestCaseError, TestRunner};
use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

/// One damage to the bytes of a file. Places are shares of its length.
#[derive(Debug, Clone)]
enum Edit {
    Set(f64, u8),
    Flip(f64, u8),
    Remove(f64, usize),
    Insert(f64, Vec<u8>),
    Copy(f64, f64, usize),
    Cut(f64),
    /// Writes a 32-bit number that may cause an overflow.
    Number(f64, u32),
    /// Replaces a number in text.
    Digits(f64, String),
}

fn edit() -> impl Strategy<Value = Edit> {
    let at = 0.0..1.0f64;
    let odd = prop::sample::select(vec![0u32, 1, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, 0x0001_0000, 0xff00_0000]);
    let digits = prop::sample::select(
        ["0", "-1", "1e400", "NaN", "18446744073709551616", "4294967296", "0.0", "-0", "[]", "null", "\"", "1e-300"]
            .map(String::from)
            .to_vec(),
    );
    prop_oneof![
        (at.clone(), any::<u8>()).prop_map(|(a, v)| Edit::Set(a, v)),
        (at.clone(), 0..8u8).prop_map(|(a, v)| Edit::Flip(a, v)),
        (at.clone(), 1..64usize).prop_map(|(a, n)| Edit::Remove(a, n)),
        (at.clone(), prop::collection::vec(any::<u8>(), 1..24)).prop_map(|(a, v)| Edit::Insert(a, v)),
        (at.clone(), 0.0..1.0f64, 1..64usize).prop_map(|(a, b, n)| Edit::Copy(a, b, n)),
        at.clone().prop_map(Edit::Cut),
        (at.clone(), odd).prop_map(|(a, v)| Edit::Number(a, v)),
        (at, digits).prop_map(|(a, v)| Edit::Digits(a, v)),
    ]
}

fn damage(mut bytes: Vec<u8>, edits: &[Edit]) -> Vec<u8> {
    for edit in edits {
        let n = bytes.len();
        let place = |share: f64| ((share * n as f64) as usize).min(n.saturating_sub(1));
        if n == 0 {
            break;
        }
        match edit {
            Edit::Set(at, value) => bytes[place(*at)] = *value,
            Edit::Flip(at, bit) => bytes[place(*at)] ^= 1 << bit,
            Edit::Remove(at, count) => drop(bytes.drain(place(*at)..(place(*at) + count).min(n))),
            Edit::Insert(at, more) => drop(bytes.splice(place(*at)..place(*at), more.iter().copied())),
            Edit::Copy(from, to, count) => {
                let part = bytes[place(*from)..(place(*from) + count).min(n)].to_vec();
                bytes.splice(place(*to)..place(*to), part);
            }
            Edit::Cut(at) => bytes.truncate(place(*at)),
            Edit::Number(at, value) => {
                let at = place(*at);
                let value = value.to_le_bytes();
                (at..(at + 4).min(n)).zip(value).for_each(|(i, v)| bytes[i] = v);
            }
            Edit::Digits(at, text) => {
                // The next run of digits from this place on.
                let start = (place(*at)..n).find(|&i| bytes[i].is_ascii_digit()).unwrap_or(n);
                let end = (start..n).find(|&i| !bytes[i].is_ascii_digit()).unwrap_or(n);
                bytes.splice(start..end, text.bytes());
            }
        }
    }
    bytes
}

/// Runs cases until the time is up, and shrinks the first fault.
fn fuzz<S: Strategy>(name: &str, cases: S, check: impl Fn(S::Value) -> Result<(), TestCaseError>) {
    let seconds = std::env::var("EYEBOX_FUZZ_SECONDS").ok().and_then(|s| s.parse::<u64>().ok());
    let limit = Duration::from_secs(seconds.unwrap_or(0));
    let start = Instant::now();
    let mut count = 0u64;
    loop {
        let config = Config { cases: 256, failure_persistence: None, max_shrink_iters: 4096, ..Config::default() };
        // A long run has new seeds. The tests have fixed seeds, so that they do not fail by chance.
        let mut runner =
            if seconds.is_some() { TestRunner::new(config) } else { TestRunner::new_with_rng(config, fixed()) };
        if let Err(fault) = runner.run(&cases, &check) {
            panic!("{name}: {fault}");
        }
        count += 256;
        if start.elapsed() >= limit {
            break;
        }
    }
    println!("{name}: {count} cases in {:.0} s", start.elapsed().as_secs_f64());
}

fn fixed() -> proptest::test_runner::TestRng {
    proptest::test_runner::TestRng::deterministic_rng(proptest::test_runner::RngAlgorithm::ChaCha)
}

fn display() -> Display {
    Display { height: 12, width: 10, ..Display::preset("small").expect("a preset") }
}

/// Checks that a loaded field has the right size and valid numbers.
fn sound(field: &scene::LightField) -> Result<(), TestCaseError> {
    prop_assert_eq!((field.height, field.width), (12, 10));
    for plane in field.planes.iter().flatten() {
        prop_assert_eq!(plane.len(), 120);
        prop_assert!(plane.iter().all(|v| v.is_finite() && *v >= 0.0));
    }
    let numbers = field.disparity.iter().chain(&field.depth).flatten().chain(&field.view_pitch);
    prop_assert!(numbers.copied().all(f64::is_finite));
    Ok(())
}

/// Checks a loaded field like [`sound`], and that an error is one line.
fn sound_or_refused(loaded: Result<scene::LightField, scene::SceneError>) -> Result<(), TestCaseError> {
    match loaded {
        Ok(field) => sound(&field),
        Err(error) => {
            let text = error.to_string();
            prop_assert!(!text.is_empty() && !text.contains('\n'), "{}", text);
            Ok(())
        }
    }
}

/// Returns a TIFF of 10 x 12 pixels without compression, with little-endian samples of `bits` bits.
fn tiff(channels: u16, bits: u16, format: u16) -> Vec<u8> {
    let count = 120 * usize::from(channels) * usize::from(bits) / 8;
    let bytes: Vec<u8> = (0..count).map(|i| if bits == 32 { [0, 0, 128, 62][i % 4] } else { (i * 7) as u8 }).collect();
    let start = 8 + bytes.len() as u32;
    let photometric = if channels == 3 { 2 } else { 1 };
    let entries: [(u16, u16, u32, u32); 9] = [
        (256, 4, 1, 10),
        (257, 4, 1, 12),
        (258, 3, 1, u32::from(bits)),
        (259, 3, 1, 1),
        (262, 3, 1, photometric),
        (273, 4, 1, 8),
        (277, 3, 1, u32::from(channels)),
        (279, 4, 1, bytes.len() as u32),
        (339, 3, 1, u32::from(format)),
    ];
    let mut out = [&b"II*\0"[..], &start.to_le_bytes(), &bytes, &9u16.to_le_bytes()].concat();
    for (tag, kind, count, value) in entries {
        out.extend([&tag.to_le_bytes()[..], &kind.to_le_bytes(), &count.to_le_bytes(), &value.to_le_bytes()].concat());
    }
    out.extend([0; 4]);
    out
}

fn png(path: &Path, salt: u32) {
    let picture = image::RgbImage::from_fn(10, 12, |x, y| image::Rgb([(x * 20 + salt) as u8, (y * 17) as u8, 90]));
    picture.save(path).expect("a picture");
}

#[test]
fn folders_of_views() {
    let temp = tempfile::tempdir().expect("a folder");
    let views = temp.path().join("views");
    fs::create_dir(&views).expect("a folder");
    for i in 0..3 {
        png(&views.join(format!("view_0_{i}.png")), i);
    }
    let jpeg = image::RgbImage::from_fn(10, 12, |x, y| image::Rgb([(x * 9) as u8, (y * 5) as u8, 77]));
    jpeg.save(views.join("view_0_3.jpg")).expect("a picture");
    let exr = image::Rgb32FImage::from_fn(10, 12, |x, y| image::Rgb([x as f32 * 0.1, y as f32 * 0.1, 0.5]));
    exr.save(views.join("view_0_4.exr")).expect("a picture");
    fs::write(views.join("view_0_5.tif"), tiff(3, 8, 1)).expect("a picture");
    fs::write(views.join("view_0_6.tif"), tiff(1, 32, 3)).expect("a picture");
    png(&views.join("view_0_7.bmp"), 3);
    png(&views.join("view_0_8.ppm"), 4);
    let toml = "grid = [1, 9]\nview_pitch_mm = 2.4\ndisparity = [-1.8, 2.1]\ndepth_mm = [-3.0, 3.5]\n";
    let cfg = "[intrinsics]\nimage_resolution_x_px = 10\nimage_resolution_y_px = 12\n[extrinsics]\nnum_cams_x = 9\nnum_cams_y = 1\n[meta]\ndisp_min = -1.8\ndisp_max = 2.1\n";
    let pfm = [b"Pf\n10 12\n-1\n".to_vec(), (0..120).flat_map(|i| (i as f32 * 0.01).to_le_bytes()).collect()].concat();
    let of = |name: &'static str| (name, fs::read(views.join(name)).expect("there"));
    let kinds = [
        of("view_0_5.tif"),
        of("view_0_6.tif"),
        of("view_0_7.bmp"),
        of("view_0_8.ppm"),
        ("view_0_0.png", fs::read(views.join("view_0_0.png")).expect("there")),
        ("view_0_3.jpg", fs::read(views.join("view_0_3.jpg")).expect("there")),
        ("view_0_4.exr", fs::read(views.join("view_0_4.exr")).expect("there")),
        ("lightfield.toml", toml.as_bytes().to_vec()),
        ("parameters.cfg", cfg.as_bytes().to_vec()),
        ("gt_disp_lowres.pfm", pfm),
    ];
    let display = display();
    let cases = (0..kinds.len(), prop::collection::vec(edit(), 1..6));
    fuzz("folders of views", cases, |(which, edits)| {
        let (name, whole) = &kinds[which];
        let file = views.join(name);
        fs::write(&file, damage(whole.clone(), &edits)).expect("written");
        let loaded = scene::load(views.to_str().expect("a name"), &Request::new(&display, &[Color::Green]));
        // Restores the file for the next case.
        if which < 7 { fs::write(&file, whole) } else { fs::remove_file(&file) }.expect("restored");
        sound_or_refused(loaded)
    });
}

/// Returns a ZIP archive of one stored file.
fn archive(name: &str, bytes: &[u8]) -> Vec<u8> {
    let mut sum = flate2::Crc::new();
    sum.update(bytes);
    let size = (bytes.len() as u32).to_le_bytes();
    let common = [&[20, 0, 0, 0, 0, 0, 0, 0, 0, 0][..], &sum.sum().to_le_bytes(), &size, &size].concat();
    let lengths = [name.len() as u8, 0, 0, 0];
    let local = [b"PK\x03\x04", &common[..], &lengths, name.as_bytes(), bytes].concat();
    let table = [b"PK\x01\x02\x14\x00", &common[..], &lengths, &[0; 14], name.as_bytes()].concat();
    let place = [(table.len() as u32).to_le_bytes(), (local.len() as u32).to_le_bytes()].concat();
    [local, table, b"PK\x05\x06\0\0\0\0\x01\0\x01\0".to_vec(), place, vec![0; 2]].concat()
}

#[test]
fn files_of_many_views() {
    let temp = tempfile::tempdir().expect("a folder");
    let values: Vec<f32> = (0..2 * 3 * 12 * 10 * 3).map(|i| (i * 7 % 23) as f32 / 23.0).collect();
    let npy = temp.path().join("views.npy");
    eyebox::low_level::files::write_npy(&npy, &[2, 3, 12, 10, 3], &values).expect("an array");
    let array = fs::read(&npy).expect("there");
    let tiles = image::RgbImage::from_fn(30, 24, |x, y| image::Rgb([(x * 8) as u8, (y * 9) as u8, 90]));
    tiles.save(temp.path().join("tiles.png")).expect("a picture");
    let tiles = fs::read(temp.path().join("tiles.png")).expect("there");
    let kinds = [
        ("views.npz", "", archive("views.npy", &array)),
        ("views.npy", "?grid=2x3&srgb", array),
        ("tiles.png", "?grid=2x3", tiles.clone()),
        ("tiles.png", "?lenslets&grid=2x3", tiles.clone()),
        ("tiles.png", "?mosaic", tiles),
    ];
    let display = display();
    let request = Request::new(&display, &[Color::Green]);
    for (name, query, whole) in &kinds[..4] {
        fs::write(temp.path().join(name), whole).expect("written");
        let field = scene::load(&format!("{}{query}", temp.path().join(name).display()), &request).expect("sound");
        assert_eq!(field.grid, [2, 3], "{name}{query}");
    }
    let cases = (0..kinds.len(), any::<bool>(), prop::collection::vec(edit(), 1..6));
    fuzz("files of many views", cases, |(which, options, edits)| {
        let (name, query, whole) = &kinds[which];
        let file = temp.path().join(name);
        let (bytes, query) = if options {
            (whole.clone(), damage(query.as_bytes().to_vec(), &edits))
        } else {
            (damage(whole.clone(), &edits), query.as_bytes().to_vec())
        };
        fs::write(&file, bytes).expect("written");
        let source = format!("{}{}", file.display(), String::from_utf8_lossy(&query));
        match scene::load(&source, &request) {
            Ok(field) => sound(&field),
            Err(error) => {
                let text = error.to_string();
                prop_assert!(!text.is_empty(), "{}", text);
                Ok(())
            }
        }
    });
}

#[test]
fn pictures_with_maps() {
    let temp = tempfile::tempdir().expect("a folder");
    let picture = temp.path().join("picture.png");
    png(&picture, 3);
    let depth16 =
        image::ImageBuffer::<image::Luma<u16>, _>::from_fn(10, 12, |x, y| image::Luma([(x * y * 500) as u16]));
    depth16.save(temp.path().join("depth.png")).expect("a map");
    let values: Vec<f32> = (0..120).map(|i| (i % 10) as f32 * 0.1 - 0.4).collect();
    eyebox::low_level::files::write_npy(&temp.path().join("disp.npy"), &[12, 10], &values).expect("a map");
    let pfm = [b"Pf\n10 12\n-1\n".to_vec(), values.iter().flat_map(|v| v.to_le_bytes()).collect()].concat();
    fs::write(temp.path().join("disp.pfm"), pfm).expect("a map");
    let exr = image::Rgb32FImage::from_fn(10, 12, |x, y| image::Rgb([(x * y) as f32; 3]));
    exr.save(temp.path().join("depth.exr")).expect("a map");
    fs::write(temp.path().join("depth.tif"), tiff(1, 16, 1)).expect("a map");
    let kinds = ["depth.png", "disp.npy", "disp.pfm", "picture.png", "depth.exr", "depth.tif"]
        .map(|n| (n, fs::read(temp.path().join(n)).expect("there")));
    let display = display();
    fuzz("pictures with maps", (0..kinds.len(), prop::collection::vec(edit(), 1..6)), |(which, edits)| {
        let (name, whole) = &kinds[which];
        let file = temp.path().join(name);
        fs::write(&file, damage(whole.clone(), &edits)).expect("written");
        let map = temp.path().join(if which == 3 { "disp.npy" } else { name });
        let request = Request {
            views: 3,
            depth_map: Some(&map),
            near: Some(eyebox::low_level::scene::Near::Large),
            depth: Some([-1e-3, 1e-3]),
            ..Request::new(&display, &[Color::Red])
        };
        let loaded = scene::load(picture.to_str().expect("a name"), &request);
        fs::write(&file, whole).expect("restored");
        loaded.map_or(Ok(()), |field| sound(&field))
    });
}

#[test]
fn built_in_scenes_by_any_name() {
    let display = display();
    let names = prop::sample::select(scene::BUILTINS.map(|b| b.name).to_vec());
    fuzz("built-in scenes", (names, prop::collection::vec(edit(), 0..4)), |(name, edits)| {
        let text = damage(format!("{name}?brightness=0.5&span=0.3").into_bytes(), &edits);
        let source = format!("builtin:{}", String::from_utf8_lossy(&text));
        let loaded = scene::load(&source, &Request { views: 2, ..Request::new(&display, &[Color::Blue]) });
        loaded.map_or(Ok(()), |field| sound(&field))
    });
}

#[test]
fn display_files() {
    let seeds: Vec<String> =
        ["paper", "plm", "small"].map(|n| Display::preset(n).expect("a preset").to_toml()).to_vec();
    fuzz("display files", (0..seeds.len(), prop::collection::vec(edit(), 1..6)), |(which, edits)| {
        let text = damage(seeds[which].clone().into_bytes(), &edits);
        let Ok(display) = Display::from_toml(&String::from_utf8_lossy(&text), "display.toml") else { return Ok(()) };
        prop_assert!(display.eyebox_min() > 0.0 && display.eyebox_min().is_finite(), "{:?}", display);
        for wavelength in &display.wavelengths {
            prop_assert!(display.optics(wavelength.color).is_ok());
        }
        // A display that was read can be written and read again.
        let again = Display::from_toml(&display.to_toml(), "again.toml");
        prop_assert!(again.is_ok(), "{:?}", again);
        Ok(())
    });
}

/// Corrects the checksum of a document, so that damage reaches the code after the check.
fn seal(bytes: &mut [u8]) {
    const SEAL: &[u8] = b"\"document_crc32c\": \"";
    let Some(at) = bytes.windows(SEAL.len()).rposition(|w| w == SEAL).map(|i| i + SEAL.len()) else { return };
    if at + 8 > bytes.len() {
        return;
    }
    bytes[at..at + 8].copy_from_slice(b"00000000");
    let sum = format!("{:08x}", crc32c::crc32c(bytes));
    bytes[at..at + 8].copy_from_slice(sum.as_bytes());
}

#[test]
fn hologram_files() {
    let temp = tempfile::tempdir().expect("a folder");
    let path = temp.path().join("h.zarr");
    let display = Display::preset("small").expect("a preset");
    let color = |color| ColorHologram {
        color: Some(color),
        wavelength: 520e-9,
        exposure: 0.4,
        efficiency: 0.3,
        phases: (0..2 * 4 * 6).map(|i| i as f32 * 0.1 - 2.0).collect(),
    };
    let whole = Hologram {
        frames: 2,
        height: 4,
        width: 6,
        pitch: 8e-6,
        focal_length: 0.4,
        geometry: eyebox::low_level::optics::Geometry::Relay,
        colors: vec![color(Color::Red), color(Color::Green)],
        seed: 7,
        version: "0.1.0".into(),
        display: "small".into(),
        display_wavelengths: display.wavelengths,
        scene: "s".into(),
        metadata: eyebox::low_level::hologram::Metadata { seconds: Some(3.0), ..Default::default() },
    };
    whole.save(&path).expect("saved");
    let names = ["zarr.json", "phases/zarr.json", "phases/c/0/1/0/0"];
    let files = names.map(|n| fs::read(path.join(n)).expect("there"));
    let cases = (0..names.len(), any::<bool>(), prop::collection::vec(edit(), 1..6));
    fuzz("hologram files", cases, |(which, sealed, edits)| {
        let file = path.join(names[which]);
        let mut bytes = damage(files[which].clone(), &edits);
        if sealed && which < 2 {
            seal(&mut bytes);
        }
        fs::write(&file, &bytes).expect("written");
        let loaded = Hologram::load(&path);
        fs::write(&file, &files[which]).expect("restored");
        let Ok(loaded) = loaded else { return Ok(()) };
        prop_assert!(loaded.colors.iter().all(|c| c.phases.len() == loaded.frames * loaded.height * loaded.width));
        prop_assert!(loaded.colors.iter().flat_map(|c| &c.phases).all(|p| p.is_finite()));
        prop_assert!(loaded.check().is_ok());
        Ok(())
    });
}

#[test]
fn bare_phases() {
    let temp = tempfile::tempdir().expect("a folder");
    let file = temp.path().join("p.npy");
    eyebox::low_level::files::write_npy(&file, &[2, 3, 4], &[0.5; 24]).expect("written");
    let whole = fs::read(&file).expect("there");
    fuzz("bare phases", prop::collection::vec(edit(), 1..6), |edits| {
        fs::write(&file, damage(whole.clone(), &edits)).expect("written");
        if let Ok(phases) = hologram::load_phases(&file, None) {
            prop_assert!(phases.colors.iter().flat_map(|c| &c.1).all(|p| p.is_finite()));
        }
        Ok(())
    });
}

/// The test covers any pupil for any grid of views, with sizes and numbers that no eye has.
#[test]
fn photographs_of_any_pupil() {
    let number = || prop_oneof![-2e-2..2e-2f64, Just(0.0), Just(1e-12), Just(-1e3), Just(1e300), Just(-1e-300)];
    let length = || prop_oneof![1e-6..5e-2f64, Just(1e-300), Just(1e3), Just(1e-9)];
    let cases = (number(), number(), length(), number(), 1..5usize, 1..5usize, length(), 1..24usize, 1..24usize);
    fuzz("photographs", cases, |(x, y, diameter, depth, rows, columns, cell, height, width)| {
        let pupil = Pupil { x, y, diameter, depth };
        let grid = ViewGrid { rows, columns, cell };
        let weights: f64 = grid.coverage(&pupil).iter().map(|c| c.1).sum();
        prop_assert!((weights - 1.0).abs() < 1e-6, "weights sum to {}", weights);
        let optics = Optics::new(height, width, 8e-6, 520e-9, 0.4).expect("sound optics");
        for tap in grid.taps_around([0.0; 2], [0.0; 2], &optics, &pupil, height, width) {
            prop_assert!(
                (tap.view as usize) < rows * columns && (tap.dy as usize) < height && (tap.dx as usize) < width,
                "{:?}",
                tap
            );
            prop_assert!((0.0..=1.0).contains(&tap.fy) && (0.0..=1.0).contains(&tap.fx), "{:?}", tap);
        }
        // The arguments for an engine must fit their own window.
        let views: Vec<Vec<f32>> = (0..rows * columns).map(|_| vec![0.25; height * width]).collect();
        let mut planner = Planner::new(optics, 1, WindowFactor::Two);
        planner.views = Some(ViewLayout::new(grid, &Pyramid::new(&views, height, width)));
        let pupil_pass = planner.pupil_pass(&pupil, &Comparison::default());
        prop_assert!(pupil_pass.window.rows <= height && pupil_pass.window.columns <= width);
        prop_assert!(pupil_pass.spans.iter().all(|s| s[0] <= s[1] && s[1] as usize <= pupil_pass.window.columns));
        Ok(())
    });
}

/// Any program on the machine may send lines to a tracker. Accepted lines contain finite numbers, up to the velocity of
/// the eye.
#[test]
fn lines_of_trackers() {
    let whole = [
        r#"{"t": 12.345, "x": 1.5, "y": -0.2, "vx": 12.0, "vy": -3.5, "diameter": 4.1, "confidence": 0.9}"#,
        r#"{"t": 1, "left": {"x": 1, "y": 2, "what": "gaze", "unit": "deg", "vx": 30, "vy": 2}, "right": {"x": 1, "y": 2}, "ipd_mm": 63}"#,
        r#"{"combined": {"x": 0.5, "y": 0.5, "z": 0.6, "unit": "normalized", "vx": 0.1, "vy": 0, "valid": true}, "focus_d": 1.5}"#,
    ];
    fuzz("lines of trackers", (0..whole.len(), prop::collection::vec(edit(), 1..6)), |(which, edits)| {
        let line = match line::parse(&damage(whole[which].as_bytes().to_vec(), &edits)) {
            Ok(line) => line,
            Err(reason) => {
                prop_assert!(!reason.text().is_empty());
                return Ok(());
            }
        };
        for reading in line.readings.iter().flatten() {
            prop_assert!(reading.position.iter().chain(reading.velocity.iter().flatten()).all(|v| v.is_finite()));
            prop_assert!(reading.valid || reading.velocity.is_none(), "{:?}", reading);
        }
        let [left, right, combined] = line.readings;
        let mut estimator = Estimator::new(Settings::default(), None).expect("the defaults");
        for i in 1..8 {
            let sample = Sample { left, right, combined, ..Sample::empty(i * 8_000_000) };
            estimator.update(&sample);
            let EyeVelocity { pupil, turning } = estimator.velocity();
            let turning = turning.map_or([0.0; 3], |([x, y], spread)| [x, y, spread]);
            prop_assert!(pupil.iter().chain(&turning).all(|v| v.is_finite()), "{:?} of {:?}", pupil, sample);
        }
        Ok(())
    });
}
