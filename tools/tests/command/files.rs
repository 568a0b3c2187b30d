//! Files as laboratories have them. Each file is read with the right values, or refused in one line with a remedy that
//! works.

use crate::common::made::tiff;
use crate::common::{command, done, eyebox, folder, refusal, refusal_of, refused, text};
use eyebox::low_level::files::{read_npy, write_npy};
use image::{GrayImage, ImageBuffer, Luma, Rgb, RgbImage};
use std::f32::consts::TAU;
use std::fs;
use std::path::Path;
use std::process::Command;

const N: u32 = 16;

/// Returns a view of a scene with two depths, in values of 8 bits.
fn view(row: i32, column: i32) -> RgbImage {
    RgbImage::from_fn(N, N, |x, y| {
        let near = (4..11).contains(&(x as i32 + column)) && (5..12).contains(&(y as i32 + row));
        let [x, y] = if near { [x as i32 + column, y as i32 + row] } else { [x as i32, y as i32] };
        let value = |k: i32| ((x * 37 + y * 91 + k * 17 + if near { 120 } else { 0 }) % 256) as u8;
        Rgb([value(1), value(2), value(3)])
    })
}

/// Writes nine views into `folder` with `save`. Their names end in `ending`.
fn views(folder: &Path, ending: &str, save: impl Fn(&RgbImage, &Path)) {
    fs::create_dir_all(folder).unwrap();
    for i in 0..9 {
        save(&view(i / 3 - 1, i % 3 - 1), &folder.join(format!("v_{}_{}.{ending}", i / 3, i % 3)));
    }
}

/// Returns the view of a scene through one pupil. The scene in any other format must give the same values.
fn seen(at: &Path, scene: &str, more: &[&str]) -> Vec<f32> {
    let words = ["render", scene, "--size", "16x16", "--pupil=0,0,8,0", "-o", "seen.npy", "--engine", "cpu"];
    done(at, &[&words[..], more].concat());
    read_npy(&at.join("seen.npy")).unwrap().values
}

fn near(a: &[f32], b: &[f32], most: f32) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= most)
}

fn words(values: &[u8]) -> Vec<u8> {
    values.iter().flat_map(|v| (u16::from(*v) * 257).to_le_bytes()).collect()
}

#[test]
fn views_in_every_format_show_the_same() {
    let here = folder();
    let at = here.path();
    let by_image = |picture: &RgbImage, file: &Path| picture.save(file).unwrap();
    views(&at.join("png"), "png", by_image);
    views(&at.join("bmp"), "bmp", by_image);
    views(&at.join("ppm"), "ppm", by_image);
    views(&at.join("upper"), "BMP", by_image);
    views(&at.join("tif8"), "tif", |picture, file| tiff(file, [N, N], [3, 8, 1], picture.as_raw()));
    views(&at.join("tif16"), "tiff", |picture, file| tiff(file, [N, N], [3, 16, 1], &words(picture.as_raw())));
    let light = |v: u8| -> [u8; 4] {
        let v = f64::from(v) / 255.0;
        (if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) } as f32).to_le_bytes()
    };
    views(&at.join("tif32"), "tif", |picture, file| {
        tiff(file, [N, N], [3, 32, 3], &picture.as_raw().iter().flat_map(|v| light(*v)).collect::<Vec<_>>());
    });
    // macOS, Windows and Linux leave such files next to pictures.
    views(&at.join("beside"), "png", |picture, file| {
        picture.save(file).unwrap();
        let name = format!("._{}", file.file_name().unwrap().to_str().unwrap());
        fs::write(file.with_file_name(name), b"\0\x05\x16\x07\0\x02\0\0Mac OS X        ").unwrap();
    });
    for name in [".DS_Store", "Thumbs.db", "desktop.ini", ".directory"] {
        fs::write(at.join("beside").join(name), [1; 90]).unwrap();
    }
    fs::create_dir(at.join("beside/__MACOSX")).unwrap();
    let right = seen(at, "png", &[]);
    assert!(right.iter().any(|v| *v > 0.1), "light");
    for folder in ["bmp", "ppm", "upper", "tif8", "tif16", "tif32", "beside"] {
        assert!(near(&seen(at, folder, &[]), &right, 2e-6), "{folder}");
    }
}

#[test]
fn a_view_whose_name_is_not_utf8_is_named_and_read_once_it_is_renamed() {
    #[cfg(unix)]
    {
        use std::ffi::OsStr;
        use std::os::unix::ffi::OsStrExt;
        let here = folder();
        let at = here.path();
        views(&at.join("v"), "png", |picture, file| picture.save(file).unwrap());
        let wrong = at.join("v").join(OsStr::from_bytes(b"caf\xe9_2_2.png"));
        let right = at.join("v/v_2_2.png");
        let whole = seen(at, "v", &[]);
        fs::rename(&right, &wrong).unwrap();
        refused(at, &["info", "v"], "x", "scene/unreadable/name-not-utf8");
        fs::rename(&wrong, &right).unwrap();
        assert_eq!(seen(at, "v", &[]), whole);
        // The name of the scene itself has the same fault.
        let scene = at.join(OsStr::from_bytes(b"caf\xe9"));
        fs::rename(at.join("v"), &scene).unwrap();
        let mut command = crate::common::command(at, &["info"]);
        crate::common::refusal_of(command.arg(&scene)).is("usage/invalid-utf8");
    }
}

/// Reorders the axes of an array. `order` lists the former axis of each axis of the result.
fn transposed(values: &[f32], shape: &[usize], order: &[usize]) -> (Vec<f32>, Vec<usize>) {
    let to: Vec<usize> = order.iter().map(|&i| shape[i]).collect();
    let place = |mut i: usize| {
        let mut index = vec![0; shape.len()];
        for (axis, n) in order.iter().zip(&to).rev() {
            (index[*axis], i) = (i % n, i / n);
        }
        index.iter().zip(shape).fold(0, |at, (i, n)| at * n + i)
    };
    ((0..values.len()).map(|i| values[place(i)]).collect(), to)
}

#[test]
fn arrays_of_other_programs_are_turned_by_the_line_that_the_refusal_gives() {
    let here = folder();
    let at = here.path();
    let shape = [3, 3, N as usize, N as usize, 3];
    let pixels: Vec<f32> =
        (0..9).flat_map(|i| view(i / 3 - 1, i % 3 - 1).into_raw()).map(|v| f32::from(v) / 255.0).collect();
    write_npy(&at.join("right.npy"), &shape, &pixels).unwrap();
    let right = seen(at, "right.npy", &[]);
    // Each case has the order of axes as stored, the remedy, and the order of the remedy.
    for (order, remedy, back) in [
        ([2, 3, 4, 0, 1], "numpy.moveaxis(views, (3, 4), (0, 1))", [3, 4, 0, 1, 2]),
        ([4, 3, 2, 1, 0], "numpy.transpose(views)", [4, 3, 2, 1, 0]),
        ([0, 1, 4, 2, 3], "numpy.moveaxis(views, 2, -1)", [0, 1, 3, 4, 2]),
        ([2, 3, 0, 1, 4], "numpy.moveaxis(views, (2, 3), (0, 1))", [2, 3, 0, 1, 4]),
        ([4, 0, 1, 2, 3], "numpy.moveaxis(views, 0, -1)", [1, 2, 3, 4, 0]),
    ] {
        let (stored, its) = transposed(&pixels, &shape, &order);
        write_npy(&at.join("other.npy"), &its, &stored).unwrap();
        let refusal = refusal(at, &["info", "other.npy"]);
        assert_eq!(refusal.code, "scene/corrupt/array-shape");
        assert!(refusal.message.contains(remedy), "{refusal:?}");
        let (turned, its) = transposed(&stored, &its, &back);
        write_npy(&at.join("other.npy"), &its, &turned).unwrap();
        assert_eq!(seen(at, "other.npy", &[]), right, "{order:?}");
    }
    // Gray views get a remedy too, and one picture is no light field.
    let gray: Vec<f32> = pixels.chunks(3).map(|p| p[1]).collect();
    let (stored, its) = transposed(&gray, &shape[..4], &[2, 3, 0, 1]);
    write_npy(&at.join("other.npy"), &its, &stored).unwrap();
    refused(at, &["info", "other.npy"], "x", "scene/corrupt/array-shape numpy.moveaxis(views");
    write_npy(&at.join("other.npy"), &[N as usize, N as usize, 3], &pixels[..(N * N * 3) as usize]).unwrap();
    refused(at, &["info", "other.npy"], "x", "scene/corrupt/array-one-picture");
}

#[test]
fn depth_maps_in_every_format_show_the_same() {
    let here = folder();
    let at = here.path();
    view(0, 0).save(at.join("photo.png")).unwrap();
    let n = N as usize;
    let depth: Vec<f32> =
        (0..n * n).map(|i| if (4..11).contains(&(i % n)) { 200.0 } else { 700.0 + (i / n) as f32 }).collect();
    write_npy(&at.join("a.npy"), &[n, n], &depth).unwrap();
    for (name, shape) in [("b.npy", vec![1, n, n]), ("c.npy", vec![n, n, 1]), ("d.npy", vec![1, 1, n, n])] {
        write_npy(&at.join(name), &shape, &depth).unwrap();
    }
    // The values are in MATLAB's order, which the header of NumPy marks.
    let header = format!("{{'descr': '<f4', 'fortran_order': True, 'shape': ({n}, {n}), }}");
    let mut bytes = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    bytes.extend(format!("{header:<117}\n").bytes());
    (0..n * n).for_each(|i| bytes.extend(depth[i % n * n + i / n].to_le_bytes()));
    fs::write(at.join("e.npy"), bytes).unwrap();
    let word = |x: u32, y: u32| depth[(y * N + x) as usize] as u16;
    ImageBuffer::<Luma<u16>, _>::from_fn(N, N, |x, y| Luma([word(x, y)])).save(at.join("f.png")).unwrap();
    let bytes: Vec<u8> = depth.iter().flat_map(|v| (*v as u16).to_le_bytes()).collect();
    tiff(&at.join("g.tif"), [N, N], [1, 16, 1], &bytes);
    let bytes: Vec<u8> = depth.iter().flat_map(|v| v.to_le_bytes()).collect();
    tiff(&at.join("h.tiff"), [N, N], [1, 32, 3], &bytes);
    ImageBuffer::<Luma<u16>, _>::from_fn(N, N, |x, y| Luma([word(x, y)])).save(at.join("i.pgm")).unwrap();
    let exr = image::Rgb32FImage::from_fn(N, N, |x, y| Rgb([f32::from(word(x, y)); 3]));
    exr.save(at.join("j.exr")).unwrap();
    let more = |map: &'static str| ["--depth-map", map, "--near", "small", "--depth=-1..1", "--views", "3"];
    let right = seen(at, "photo.png", &more("a.npy"));
    for map in ["b.npy", "c.npy", "d.npy", "e.npy", "g.tif", "h.tiff", "j.exr"] {
        assert!(near(&seen(at, "photo.png", &more(map)), &right, 1e-6), "{map}");
    }
    // The largest value of the PGM stretches its 16-bit values, and the values of the PNG stay. The proportions are the
    // same.
    for map in ["f.png", "i.pgm"] {
        assert!(near(&seen(at, "photo.png", &more(map)), &right, 1e-4), "{map}");
    }
}

/// Files that hold no scene, with their name, first bytes, kind and remedy.
const NO_SCENE: [(&str, &[u8], &str, &str); 22] = [
    ("lf.mat", b"MATLAB 5.0 MAT-file, Platform: GLNXA64", "matlab", "scipy.io"),
    ("lf73.mat", b"MATLAB 7.3 MAT-file, Platform: GLNXA64", "matlab73", "h5py"),
    ("lf.h5", b"\x89HDF\r\n\x1a\n", "hdf5", "h5py"),
    ("clip.mp4", b"\0\0\0\x18ftypisom", "MP4", "ffmpeg -i clip.mp4"),
    ("clip.mov", b"\0\0\0\x14ftypqt  ", "QuickTime", "clip.y4m"),
    ("clip.mkv", b"\x1a\x45\xdf\xa3", "Matroska", "clip.y4m"),
    ("clip.avi", b"RIFF\0\0\0\0AVI ", "AVI", "clip.y4m"),
    ("a.heic", b"\0\0\0\x18ftypheic", "HEIC", "a.png"),
    ("a.jpg", b"\0\0\0\x18ftypheic", "HEIC", "a.png"),
    ("a.webp", b"RIFF\0\0\0\0WEBPVP8 ", "WebP", "a.png"),
    ("a.psd", b"8BPS\0\x01", "Photoshop", "a.png"),
    ("a.dng", b"II*\0\x08\0\0\0", "camera-raw", "a.tif"),
    ("a.cr3", b"\0\0\0\x18ftypcrx ", "camera-raw", "a.tif"),
    ("a.pdf", b"%PDF-1.7", "pdf", "pdftoppm"),
    ("a.pkl", b"\x80\x04\x95", "pickle", "a.npy"),
    ("a.npy", b"\x80\x04\x95", "pickle", "a.npy"),
    ("passwd", b"root:x:0:0:root:/root:/bin/bash\n", "text", "builtin:NAME"),
    ("a.svg", b"<svg xmlns='http://www.w3.org/2000/svg'/>", "markup", "builtin:NAME"),
    ("empty.png", b"", "empty", "builtin:NAME"),
    ("a.tar.gz", b"\x1f\x8b\x08", "gzip", "unpack"),
    ("a.lfp", b"\x89LFP\r\n\x1a\n", "Lytro", "builtin:NAME"),
    ("a.bin", &[3, 1, 4, 1, 5, 9], "unknown", "builtin:NAME"),
];

#[test]
fn what_is_no_scene_is_called_what_it_is_with_the_line_that_converts_it() {
    let here = folder();
    let at = here.path();
    for (name, bytes, kind, remedy) in NO_SCENE {
        fs::write(at.join(name), bytes).unwrap();
        let is = |words: &[&str], code: &str| {
            // With ffmpeg on the path, a damaged video is one.
            let refusal = refusal_of(command(at, words).env("PATH", ""));
            assert_eq!(refusal.code, code, "{words:?}: {refusal:?}");
            let found = &refusal.fields["found"];
            let found = found.as_object().and_then(|named| named.values().next()).unwrap_or(found);
            assert!(found.as_str().is_some_and(|found| found.contains(kind)), "{words:?}: {refusal:?}");
            refusal
        };
        for words in [&["info", name][..], &["solve", name, "-o", "x.zarr"], &["solve", name, "--dry-run"]] {
            let refusal = is(words, "scene/kind");
            assert!(refusal.message.contains(remedy), "{words:?}: {refusal:?}");
        }
        // The same file is refused as a depth map and as phases.
        view(0, 0).save(at.join("photo.png")).unwrap();
        is(&["info", "photo.png", "--depth-map", name], "scene/kind");
        is(&["convert", name, "x.zarr", "--display", "small", "--color", "green"], "file/kind");
    }
    // A folder of such files is refused as well.
    fs::create_dir(at.join("webp")).unwrap();
    for i in 0..9 {
        fs::write(at.join(format!("webp/v_{i}.webp")), b"RIFF\0\0\0\0WEBPVP8 ").unwrap();
    }
    refused(at, &["info", "webp"], "x", "scene/kind");
}

/// Runs the command at the end of a refusal. Returns false if Python lacks the modules that the command needs.
fn follow(at: &Path, said: &str, needs: &str) -> bool {
    let has = Command::new("python").args(["-c", &format!("import {needs}")]).output();
    if !has.is_ok_and(|answer| answer.status.success()) {
        eprintln!("left out: python has no {needs}");
        return false;
    }
    let line = &said[said.find("python").expect("a remedy")..].trim();
    let answer = Command::new("sh").args(["-c", line]).current_dir(at).output().unwrap();
    assert!(answer.status.success(), "{line}: {}", text(&answer.stderr));
    true
}

#[test]
fn the_lines_for_python_make_arrays_that_show_the_same() {
    let here = folder();
    let at = here.path();
    let pixels: Vec<f32> =
        (0..9).flat_map(|i| view(i / 3 - 1, i % 3 - 1).into_raw()).map(|v| f32::from(v) / 255.0).collect();
    write_npy(&at.join("right.npy"), &[3, 3, N as usize, N as usize, 3], &pixels).unwrap();
    let right = seen(at, "right.npy", &[]);
    for (name, needs, make) in [
        ("a.mat", "numpy, scipy.io", "scipy.io.savemat('a.mat', {'LF': v, 'note': 'mine'})"),
        ("b.h5", "numpy, h5py", "f = h5py.File('b.h5', 'w'); f['x/LF'] = v; f['n'] = 3; f.close()"),
        ("c.pkl", "numpy, pickle", "pickle.dump(v, open('c.pkl', 'wb'))"),
    ] {
        let script = format!("import {needs}; v = numpy.load('right.npy'); {make}");
        let made = Command::new("python").args(["-c", &script]).current_dir(at).output();
        if !made.is_ok_and(|answer| answer.status.success()) {
            eprintln!("left out: python has no {needs}");
            continue;
        }
        let answer = eyebox(at, &["info", name]);
        let said = text(&answer.stderr);
        assert_eq!(answer.status.code(), Some(2), "{name}: {said}");
        assert!(follow(at, &said, needs));
        assert_eq!(seen(at, &Path::new(name).with_extension("npy").display().to_string(), &[]), right, "{name}");
    }
}

/// Returns the phase of a level in radians. `turn` is the number of levels per turn.
fn radians(level: f32, turn: f32) -> f32 {
    let phase = level / turn * TAU;
    if phase >= TAU / 2.0 { phase - TAU } else { phase }
}

fn level(x: u32, y: u32, k: u32) -> u8 {
    ((x * 11 + y * 29 + k * 83) % 256) as u8
}

#[test]
fn phases_as_pictures_are_imported_by_the_documented_rule() {
    let here = folder();
    let at = here.path();
    for name in ["eight", "sixteen", "three"] {
        fs::create_dir(at.join(name)).unwrap();
    }
    for k in 0..3 {
        GrayImage::from_fn(N, N, |x, y| Luma([level(x, y, k)]))
            .save(at.join(format!("eight/phase_{k:03}.bmp")))
            .unwrap();
        let wide = (0..N * N).flat_map(|i| (u16::from(level(i % N, i / N, k)) * 256).to_le_bytes()).collect::<Vec<_>>();
        tiff(&at.join(format!("sixteen/frame{k}.tif")), [N, N], [1, 16, 1], &wide);
        let rgb = RgbImage::from_fn(N, N, |x, y| Rgb([level(x, y, k), level(x, y, k + 3), level(x, y, k + 6)]));
        rgb.save(at.join(format!("three/{k}.png"))).unwrap();
    }
    let import = |file: &str, more: &[&str]| -> Vec<f32> {
        let words = ["convert", file, "h.zarr", "--display", "small", "--size", "16x16"];
        done(at, &[&words[..], more].concat());
        done(at, &["convert", "h.zarr", "p.npy"]);
        read_npy(&at.join("p.npy")).unwrap().values
    };
    let wanted = |k: u32| (0..N * N).map(move |i| radians(f32::from(level(i % N, i / N, k)), 256.0));
    let gray: Vec<f32> = (0..3).flat_map(wanted).collect();
    let green = ["--color", "green"];
    assert!(near(&import("eight", &green), &gray, 1e-6), "8 bits");
    assert!(near(&import("sixteen", &green), &gray, 1e-6), "16 bits");
    assert!(near(&import("eight/phase_001.bmp", &green), &wanted(1).collect::<Vec<_>>(), 1e-6), "one");
    let colored: Vec<f32> = (0..3).flat_map(|color| (0..3).flat_map(move |k| wanted(k + 3 * color))).collect();
    assert!(near(&import("three", &[]), &colored, 1e-6), "three colors");
    let blue: Vec<f32> = (0..3).flat_map(|k| wanted(k + 6)).collect();
    assert!(near(&import("three", &["--color", "blue"]), &blue, 1e-6), "blue of three");
    let half: Vec<f32> = (0..3)
        .flat_map(|k| (0..N * N).map(move |i| f32::from(level(i % N, i / N, k))))
        .map(|l| radians(l % 128.0, 128.0))
        .collect();
    assert!(near(&import("eight", &["--color", "green", "--phase-unit", "128"]), &half, 1e-5), "128 levels a turn");

    // Pictures are refused if they lack the color or a sub-frame, have two phases only, or are lossy.
    let plain = ["convert", "eight", "x.zarr", "--display", "small", "--size", "16x16"];
    refused(at, &plain, "x.zarr", "hologram/doubtful/colors-not-named --color");
    fs::rename(at.join("eight/phase_001.bmp"), at.join("one.bmp")).unwrap();
    refused(at, &[&plain[..], &green].concat(), "x.zarr", "hologram/not-a-hologram/missing-sub-frame phase_002.bmp");
    let binary = GrayImage::from_fn(N, N, |x, y| Luma([if level(x, y, 1) > 127 { 255 } else { 0 }]));
    binary.save(at.join("two.png")).unwrap();
    let two = ["convert", "two.png", "x.zarr", "--display", "small", "--size", "16x16", "--color", "green"];
    refused(at, &two, "x.zarr", "hologram/doubtful/two-levels --phase-unit 510");
    let phases = import("two.png", &["--color", "green", "--phase-unit", "510"]);
    assert!(phases.iter().all(|p| p.abs() < 1e-6 || (p.abs() - TAU / 2.0).abs() < 1e-6));
    binary.save(at.join("two.jpg")).unwrap();
    refused(
        at,
        &["convert", "two.jpg", "x.zarr", "--display", "small", "--color", "green"],
        "x.zarr",
        "file/content/jpeg",
    );
}

#[test]
fn phases_whose_last_axis_counts_sub_frames_are_refused_and_the_line_turns_them() {
    let here = folder();
    let at = here.path();
    let values: Vec<f32> = (0..4 * 24 * 24).map(|i| (i * 7919 % 6283) as f32 / 1000.0 - 3.1).collect();
    let shape = [4, 24, 24];
    write_npy(&at.join("right.npy"), &shape, &values).unwrap();
    let import = |file: &'static str, size: &'static str| {
        ["convert", file, "h.zarr", "--display", "small", "--size", size, "--color", "green"]
    };
    done(at, &import("right.npy", "24x24"));
    done(at, &["convert", "h.zarr", "right-again.npy"]);
    fs::remove_dir_all(at.join("h.zarr")).unwrap();
    let (last, its) = transposed(&values, &shape, &[1, 2, 0]);
    write_npy(&at.join("last.npy"), &its, &last).unwrap();
    refused(at, &import("last.npy", "24x24"), "h.zarr", "hologram/not-a-hologram/shape numpy.moveaxis(phases");
    // Without the size of a display, the shape alone decides. A display decides by its rows and columns.
    let bare = ["--pitch", "8", "--wavelength", "520", "--focal-length", "400"];
    let (many, its) = transposed(&vec![0.5; 8 * 64 * 64], &[8, 64, 64], &[1, 2, 0]);
    write_npy(&at.join("many.npy"), &its, &many).unwrap();
    refused(
        at,
        &[&["convert", "many.npy", "h.zarr"][..], &bare].concat(),
        "h.zarr",
        "hologram/doubtful/sub-frames-last numpy.moveaxis(phases",
    );
    let (some, its) = transposed(&vec![0.5; 16 * 24 * 24], &[16, 24, 24], &[1, 2, 0]);
    write_npy(&at.join("some.npy"), &its, &some).unwrap();
    refused(at, &import("some.npy", "24x24"), "h.zarr", "hologram/doubtful/sub-frames-last numpy.moveaxis(phases");
    // If the display has just these rows and columns, `--force` accepts the array.
    done(at, &[&import("many.npy", "64x8")[..], &["--force"]].concat());
    let (turned, its) = transposed(&last, &its_of(&shape, &[1, 2, 0]), &[2, 0, 1]);
    write_npy(&at.join("last.npy"), &its, &turned).unwrap();
    done(at, &import("last.npy", "24x24"));
    done(at, &["convert", "h.zarr", "again.npy"]);
    assert_eq!(fs::read(at.join("again.npy")).unwrap(), fs::read(at.join("right-again.npy")).unwrap());
}

fn its_of(shape: &[usize], order: &[usize]) -> Vec<usize> {
    order.iter().map(|&i| shape[i]).collect()
}

#[test]
fn tables_in_every_encoding_encode_the_same() {
    let here = folder();
    let at = here.path();
    let display = "resolution = [16, 16]\npitch_um = 8.0\nfocal_length_mm = 400.0\nlevels = 256\n\
                   wavelengths_nm = { green = 520 }\n[encoding]\npacking = \"grey8\"\nlook_up = { green = \"TABLE\" }\n";
    let table: String =
        (0..256).map(|i| format!("{i},{:.4}\n", f64::from(i) * f64::from(i) / 255.0 * 0.0246 * 1.1)).collect();
    let table = format!("level,phase_rad\n{table}");
    let wide = |big: bool| -> Vec<u8> {
        table.encode_utf16().flat_map(|u| if big { u.to_be_bytes() } else { u.to_le_bytes() }).collect()
    };
    let cases: [(&str, Vec<u8>); 7] = [
        ("utf8.csv", table.clone().into()),
        ("bom.csv", [b"\xef\xbb\xbf", table.as_bytes()].concat()),
        ("cr.csv", table.replace('\n', "\r").into()),
        ("crlf.csv", table.replace('\n', "\r\n").into()),
        ("utf16.csv", [&b"\xff\xfe"[..], &wide(false)].concat()),
        ("utf16be.csv", [&b"\xfe\xff"[..], &wide(true)].concat()),
        (
            "tab16.txt",
            [&b"\xff\xfe"[..], &table.replace(',', "\t").encode_utf16().flat_map(u16::to_le_bytes).collect::<Vec<_>>()]
                .concat(),
        ),
    ];
    done(
        at,
        &[
            "solve",
            "builtin:plane",
            "--size",
            "16x16",
            "--color",
            "green",
            "--steps",
            "1",
            "--frames",
            "1",
            "--engine",
            "cpu",
            "-o",
            "h.zarr",
        ],
    );
    let mut first = None;
    for (name, bytes) in cases {
        fs::write(at.join(name), bytes).unwrap();
        // The display's own file is in UTF-16 as well.
        let text = display.replace("TABLE", name);
        let wide: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
        fs::write(at.join("bench.toml"), [&b"\xff\xfe"[..], &wide].concat()).unwrap();
        let out = format!("{name}-frames");
        done(at, &["encode", "h.zarr", "--display", "bench.toml", "--engine", "cpu", "-o", &out]);
        let picture = fs::read_dir(at.join(&out))
            .unwrap()
            .map(|e| e.unwrap().path())
            .find(|f| f.extension().is_some_and(|e| e == "png"));
        let levels = image::open(picture.unwrap()).unwrap().into_luma8().into_raw();
        assert_eq!(*first.get_or_insert_with(|| levels.clone()), levels, "{name}");
    }
    // A table of voltages and a workbook are refused.
    let dac: String = (0..256).map(|i| format!("{i} {}\n", 727 + i * 13)).collect();
    for (name, bytes, says) in [
        ("m.lut", dac.as_bytes(), "encode/table/driver-values m.lut"),
        ("t.xls", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "file/kind"),
    ] {
        fs::write(at.join(name), bytes).unwrap();
        fs::write(at.join("bench.toml"), display.replace("TABLE", name)).unwrap();
        refused(at, &["encode", "h.zarr", "--display", "bench.toml", "--engine", "cpu", "-o", "x"], "x", says);
    }
}
