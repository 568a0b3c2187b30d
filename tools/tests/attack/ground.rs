//! Makes small holograms, scenes, tables and recordings of every kind. The cases only read them.

use image::{DynamicImage, GrayImage, ImageFormat, Rgb32FImage, RgbImage};
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::{OsStr, OsString};
use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A display with the pixels of the holograms, and with every field that a display file can have for a relay.
pub const BENCH: &str = "name = \"bench\"\nresolution = [16, 16]\npitch_um = 8.0\nfocal_length_mm = 400.0\nlevels = 256\nrate_hz = 60\n\
    portrait = false\ngeometry = \"relay\"\n[wavelengths_nm]\nred = 660.0\ngreen = 520.0\nblue = 440.0\n[encoding]\npacking = \"grey8\"\n\
    channel = \"grey\"\nchannel_order = \"rgb\"\nflip = \"horizontal\"\nrotation_deg = 90\noffset_px = [1, -2]\nflip_video = \"none\"\n\
    look_up = { green = \"green.csv\" }\n[[encoding.correction]]\nfile = \"flat.png\"\nsign = 1\ncolor = \"red\"\n\
    two_pi_level = 256\norientation = \"slm\"\n[[encoding.correction]]\nfile = \"flat.npy\"\nsign = -1\norientation = \"hologram\"\n\
    [[encoding.grating]]\nperiod_px = 8.0\ndirection_deg = 30\ncolor = \"green\"\n";
/// A display with bit planes, cells and a table.
const PLANES: &str = "resolution = [16, 16]\npitch_um = 10.8\nfocal_length_mm = 400.0\nlevels = 4\nwavelengths_nm = { green = 520.0 }\n\
    [encoding]\npacking = \"map\"\nphases_turns = [0.0, 0.25, 0.5, 0.75]\ncodes = [0, 1, 3, 2]\ncells = [[0, 1]]\n\
    [[encoding.map]]\ncolor = \"green\"\nsub_frame = 0\nvideo_frame = 0\nchannel = \"green\"\nbits = [0]\n\
    [[encoding.map]]\ncolor = \"green\"\nsub_frame = 1\nvideo_frame = 0\nchannel = \"rgb\"\nbits = [23]\n";
/// Tables with the settings of commands.
const TABLES: &str = "[gaze]\nfixation = '250ms'\nstep_time = 1\ncontent = ['still', 'jumping']\nsets = 4\nsteps_per_set = 1\n\
                      jumps_every = 2\njumps_to = ['builtin:points']\n[show]\nmoments = 'off'\nsync = 0.01\nahead = 2\nspeed = 2.0\n\
                      keep_phase = true\n[compare]\nspeckle = false\ncoherence = [0, 0.5]\n[viewing]\nluminance = 100\nblack = 0.5\n\
                      pixels_per_degree = 20\n[tiles]\npicture = 32\npasses = 1\n[camera]\niris = [0, 0, 6]\nsettle = 0\n";

/// A display whose SLM is in the pupil plane.
const FAR: &str = "name = \"far\"\nresolution = [128, 128]\npitch_um = 10.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n\
    geometry = \"far-field\"\n";
const LIGHT_FIELD: &str = "grid = [3, 3]\nfiles = \"view_*\"\ntranspose = false\nflip_rows = false\nflip_columns = false\n\
    view_pitch_mm = 2.2\ndisparity = [-1.5, 1.2]\ndepth_mm = [-1.0, 1.0]\ntransfer = \"srgb\"\n";
const DEVICE: &str = "name = \"Bench tracker\"\nvendor = 0x1234\nproduct = 0x5678\nreport_id = 1\nbytes = 14\nstart = [0x05, 0x01]\n\
    time = { offset = 1, size = 4, scale = 1e-6 }\n[left]\nunit = \"mm\"\nwhat = \"pupil\"\n\
    x = { offset = 5, size = 2, signed = true, scale = 0.001, range = [-9000, 9000] }\n\
    y = { offset = 7, size = 2, signed = true, scale = 0.001 }\ndiameter = { offset = 9, size = 2, scale = 0.001 }\n\
    confidence = { offset = 11, size = 1, scale = 0.00392 }\nvalid = { offset = 12, size = 1 }\n";
const CALIBRATION: &str = "user = \"ada\"\n[left]\nunit = \"normalized\"\nx_mm = [21.5, 0.3, -10.9]\ny_mm = [-0.2, 22.1, -11.0]\nresidual_mm = 0.12\n\
    [right]\nunit = \"mm\"\nx_mm = [1.0, 0.0, 0.0]\ny_mm = [0.0, 1.0, 0.0]\nresidual_mm = 0.1\n";
const DESCRIPTOR: &str = "05 12 09 01 a1 01 09 10 a1 02 85 01 65 11 55 0c 17 80 7b e1 ff 27 80 84 1e 00 \
                          09 24 a1 00 75 20 95 02 09 21 09 22 81 03 c0 c0 c0";

/// The files that all cases start from, and the options of the command.
pub struct Ground {
    folder: tempfile::TempDir,
    /// The options of each command, as its help lists them.
    pub options: BTreeMap<String, Vec<crate::options::Opt>>,
    /// The bytes of every file below `base`.
    pub files: BTreeMap<String, Vec<u8>>,
}

impl Ground {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let at = folder.path();
        pictures(&at.join("base"));
        texts(&at.join("base"));
        for args in [
            "solve builtin:plane --size 16x16 --color green --engine cpu --steps 1 --frames 2 -o base/h.zarr",
            "solve builtin:plane --size 16x16 --engine cpu --steps 1 --frames 1 -o base/rgb.zarr",
            "solve builtin:plane builtin:plane?depth=1 --size 16x16 --color green --engine cpu --steps 1 --frames 1 -o base/moving.zarr",
            "solve builtin:plane --display base/far.toml --frames 1 --memory 600MiB --pupil-diameter 0.2..0.4 --set tiles.picture=32 --set tiles.passes=1 \
             --steps 1 --engine cpu -o base/far.zarr",
            "convert base/h.zarr base/phases.npy",
            "convert base/h.zarr base/pictures",
            "encode base/h.zarr --display grey8 --size 16x16 -o base/frames",
            "tracker record simulated --duration 0.1 -o base/eye.jsonl",
        ] {
            done(at, args, &at.join("cache"));
        }
        // One measurement of this machine's rates serves all tests of the command.
        let shared = std::env::temp_dir().join("eyebox-tests");
        done(at, "solve builtin:plane --dry-run --size 16x16 --color green --engine cpu", &shared);
        copy(&shared, &at.join("cache"));
        let name = |f: &PathBuf| f.strip_prefix(at).expect("inside").to_str().expect("text").to_string();
        let files = files(&at.join("base")).iter().map(|f| (name(f), fs::read(f).expect("a file"))).collect();
        Self { options: crate::options::all(), files, folder }
    }

    /// Copies the files for a worker.
    pub fn place(&self, _worker: usize) -> Place {
        let folder = tempfile::tempdir().expect("a temporary folder");
        for part in ["base", "cache"] {
            copy(&self.folder.path().join(part), &folder.path().join(part));
        }
        let sum = sum(folder.path());
        let outputs = self.options.values().flatten().filter(|opt| opt.is_output() && opt.name != "out");
        let logs = outputs.map(|opt| format!("--{}", opt.name).into()).collect();
        Place { folder, sum, logs }
    }
}

/// The folder in which a worker's cases run one after the other.
pub struct Place {
    folder: tempfile::TempDir,
    sum: BTreeMap<PathBuf, u32>,
    logs: BTreeSet<OsString>,
}

impl Place {
    /// Returns whether an argument names an output in addition to the result, such as `--stats`.
    pub fn is_log(&self, arg: &OsStr) -> bool {
        self.logs.contains(arg)
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Empties the folders of a case's inputs and results.
    pub fn clear(&self) {
        for name in ["in", "out"] {
            let at = self.path().join(name);
            if at.exists() {
                fs::remove_dir_all(&at).expect("removed");
            }
            fs::create_dir(&at).expect("a folder");
        }
    }

    /// Checks that a case left all other files unchanged. The error names a file that changed.
    pub fn check(&self) -> Result<(), String> {
        let (now, mut tops) = (sum(self.path()), fs::read_dir(self.path()).expect("a folder"));
        let other = |(file, sum): (&PathBuf, &u32), than: &BTreeMap<PathBuf, u32>| than.get(file) != Some(sum);
        let changed = now.iter().find(|f| other(*f, &self.sum)).or(self.sum.iter().find(|f| other(*f, &now)));
        if let Some((file, _)) = changed {
            return Err(file.display().to_string());
        }
        let known = ["base", "cache", "in", "out"];
        let new = tops.find(|e| !known.iter().any(|k| e.as_ref().expect("an entry").file_name() == *k));
        let Some(Ok(new)) = new else { return Ok(()) };
        if new.path().is_dir() { fs::remove_dir_all(new.path()) } else { fs::remove_file(new.path()) }
            .expect("removed");
        Err(format!("the folder that it ran in: {} is new", new.file_name().display()))
    }
}

fn sum(at: &Path) -> BTreeMap<PathBuf, u32> {
    files(&at.join("base")).into_iter().map(|f| (f.clone(), crc32c::crc32c(&fs::read(&f).expect("a file")))).collect()
}

/// Returns every file, pipe and link below a folder, and every empty folder.
pub fn files(folder: &Path) -> Vec<PathBuf> {
    let (mut found, mut left) = (Vec::new(), vec![folder.to_path_buf()]);
    while let Some(next) = left.pop() {
        let entries: Vec<_> = fs::read_dir(&next).map(|e| e.flatten().collect()).unwrap_or_default();
        if entries.is_empty() && next != folder {
            found.push(next);
            continue;
        }
        for entry in entries {
            let folder = entry.file_type().is_ok_and(|kind| kind.is_dir());
            if folder { left.push(entry.path()) } else { found.push(entry.path()) }
        }
    }
    found
}

/// Copies a file or a folder.
pub fn copy(from: &Path, to: &Path) {
    if from.is_dir() {
        fs::create_dir_all(to).expect("a folder");
        for entry in fs::read_dir(from).expect("a folder") {
            let entry = entry.expect("an entry");
            copy(&entry.path(), &to.join(entry.file_name()));
        }
    } else {
        fs::copy(from, to).expect("a copy");
    }
}

fn done(at: &Path, args: &str, cache: &Path) {
    let mut command = Command::new(crate::case::program());
    let answer = command.args(args.split_whitespace()).current_dir(at).env("XDG_CACHE_HOME", cache).output();
    let answer = answer.expect("the command starts");
    assert!(answer.status.success(), "{args}: {}", String::from_utf8_lossy(&answer.stderr));
}

/// Writes a folder of views, a picture and its depth in every format, and corrections for the display.
fn pictures(base: &Path) {
    for folder in ["views", "bench"] {
        fs::create_dir_all(base.join(folder)).expect("a folder");
    }
    let value = |x: u32, y: u32, n: u32| ((x * 37 + y * 91 + n * 17) % 256) as u8;
    let rgb = |n| RgbImage::from_fn(16, 16, |x, y| image::Rgb([value(x, y, n), value(y, x, n), value(x, x, n)]));
    for i in 0..9u32 {
        let file = base.join(format!("views/view_{:02}_{:02}.png", i / 3, i % 3));
        rgb(0).save_with_format(file, ImageFormat::Png).expect("a picture");
    }
    for (name, format) in [("png", ImageFormat::Png), ("jpg", ImageFormat::Jpeg), ("bmp", ImageFormat::Bmp)] {
        rgb(3).save_with_format(base.join(format!("photo.{name}")), format).expect("a picture");
    }
    let light = Rgb32FImage::from_fn(16, 16, |x, y| image::Rgb([x as f32 / 16.0, y as f32 / 16.0, 0.5]));
    let mut exr = Cursor::new(Vec::new());
    DynamicImage::ImageRgb32F(light).write_to(&mut exr, ImageFormat::OpenExr).expect("a picture");
    fs::write(base.join("photo.exr"), exr.into_inner()).expect("a file");
    fs::write(base.join("photo.tif"), tiff(rgb(3).as_raw())).expect("a file");
    rgb(3).save_with_format(base.join("photo.ppm"), ImageFormat::Pnm).expect("a picture");
    let depth = GrayImage::from_fn(16, 16, |x, y| image::Luma([value(x, y, 5)]));
    depth.save_with_format(base.join("depth.png"), ImageFormat::Png).expect("a picture");
    depth.save_with_format(base.join("bench/flat.png"), ImageFormat::Png).expect("a picture");
    let numbers: Vec<f32> = (0..256).map(|i| (i % 16) as f32 / 16.0).collect();
    let bytes: Vec<u8> = numbers.iter().flat_map(|v| v.to_le_bytes()).collect();
    fs::write(base.join("depth.pfm"), [b"Pf\n16 16\n-1.0\n", &bytes[..]].concat()).expect("a file");
    for file in ["depth.npy", "bench/flat.npy"] {
        eyebox::low_level::files::write_npy(&base.join(file), &[16, 16], &numbers).expect("a file");
    }
}

/// Returns a TIFF of 16 x 16 pixels in color, without compression.
fn tiff(bytes: &[u8]) -> Vec<u8> {
    let start = 8 + bytes.len() as u32;
    let entries: [(u16, u16, u32); 8] = [
        (256, 4, 16),
        (257, 4, 16),
        (258, 3, 8),
        (259, 3, 1),
        (262, 3, 2),
        (273, 4, 8),
        (277, 3, 3),
        (279, 4, bytes.len() as u32),
    ];
    let mut out = [&b"II*\0"[..], &start.to_le_bytes(), bytes, &8u16.to_le_bytes()].concat();
    for (tag, kind, value) in entries {
        out.extend([&tag.to_le_bytes()[..], &kind.to_le_bytes(), &1u32.to_le_bytes(), &value.to_le_bytes()].concat());
    }
    out.extend([0; 4]);
    out
}

/// Writes tables, display files and other descriptions.
fn texts(base: &Path) {
    let table: String = (0..256).map(|i| format!("{i},{}\n", f64::from(i) * 0.0246)).collect();
    let write = |name: &str, text: &str| fs::write(base.join(name), text).expect("a file");
    write("bench/bench.toml", BENCH);
    write("bench/green.csv", &format!("level,phase_rad\n{table}"));
    write("planes.toml", PLANES);
    write("far.toml", FAR);
    write("views/lightfield.toml", LIGHT_FIELD);
    write("device.toml", DEVICE);
    write("ada.toml", CALIBRATION);
    write("descriptor.txt", DESCRIPTOR);
    let count = DESCRIPTOR.split_whitespace().count();
    write(
        "eye.hid",
        &format!(
            "# by hand\nR: {count} {DESCRIPTOR}\nN: By Hand\nP: usb\nI: 3 1234 5678\nE: 0.000000 9 01 40 0d 03 00 b0 3c ff ff\n\
             E: 0.010000 9 01 81 84 1e 00 00 00 00 00\n"
        ),
    );
    write("slm.toml", "levels = [0.0, 1.5, 3.0, 4.5]\noptimizer.momentum = 0.25\nrefine.strategy = 'adam'\n");
    write("tables.toml", TABLES);
    write("pupils.json", "[[0, 0, 4, 0], [1, -1, 2, \"0.01D\"]]");
    write("numbers.csv", "method,group,psnr_db\nslfh,random,30.0\n");
}
