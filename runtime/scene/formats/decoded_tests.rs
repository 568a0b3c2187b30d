//! Tests the colors, the frames and the refusals of videos that ffmpeg decodes.

use super::*;
use crate::formats::{decoder, video};
use crate::light_field::near::Kind;
use crate::srgb_to_linear;
use eyebox_base::error::ErrorData;
use std::io::Write;
use std::process::{Command, Stdio};

const COLORS: [Color; 3] = [Color::Red, Color::Green, Color::Blue];
/// One color per frame, as red, green and blue of 8 bits.
const FRAMES: [[u8; 3]; 4] = [[255, 0, 0], [0, 255, 0], [20, 60, 250], [255, 255, 255]];

/// Returns true where ffmpeg is missing, and these tests cannot run.
fn is_missing() -> bool {
    let missing = !decoder::decodes(Path::new("a.mkv"));
    if missing {
        eprintln!("ffmpeg is missing: skipped");
    }
    missing
}

/// Encodes frames of raw samples by ffmpeg with these options.
fn encode(file: &Path, input: &str, samples: &[u8], options: &str) {
    let mut child = Command::new("ffmpeg")
        .args(["-nostdin", "-y", "-v", "error", "-f", "rawvideo"])
        .args(input.split(' '))
        .args(["-i", "-"])
        .args(options.split(' '))
        .arg(file)
        .stdin(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(samples).unwrap();
    assert!(child.wait().unwrap().success(), "{options}");
}

fn frames([rows, columns]: [usize; 2]) -> Vec<u8> {
    FRAMES.iter().flat_map(|color| color.repeat(rows * columns)).collect()
}

fn assert_color(picture: &Picture, color: [u8; 3], tolerance: f32, what: &str) {
    for (plane, value) in picture.planes.iter().zip(color) {
        let exact = srgb_to_linear(f64::from(value) / 255.0) as f32;
        let worst = plane.iter().map(|v| (v - exact).abs()).fold(0.0, f32::max);
        assert!(worst < tolerance, "{what}: {} instead of {exact}", plane[0]);
    }
}

#[test]
fn every_matrix_range_and_depth_gives_its_colors() {
    if is_missing() {
        return;
    }
    let here = tempfile::tempdir().unwrap();
    let file = here.path().join("a.mkv");
    let (small, high) = ([48, 64], [720, 1280]);
    let cases = [
        (small, "scale=out_color_matrix=bt709:out_range=tv -pix_fmt yuv444p -colorspace bt709 -color_range tv", 0.02),
        (small, "scale=out_color_matrix=bt709:out_range=pc -pix_fmt yuv444p -colorspace bt709 -color_range pc", 0.02),
        (
            small,
            "scale=out_color_matrix=bt601:out_range=tv -pix_fmt yuv420p -colorspace smpte170m -color_range tv",
            0.02,
        ),
        (small, "scale=out_color_matrix=bt601:out_range=tv -pix_fmt yuv422p10le -colorspace bt470bg", 0.006),
        (small, "scale=out_color_matrix=bt709:out_range=tv -pix_fmt yuv444p12le -colorspace bt709", 0.002),
        // A matrix that is not stated is the usual one.
        (small, "scale=out_color_matrix=bt601:out_range=tv -pix_fmt yuv444p", 0.02),
        (high, "scale=out_color_matrix=bt709:out_range=tv -pix_fmt yuv420p", 0.02),
        (small, "null -pix_fmt bgra", 0.002),
        (small, "null -pix_fmt gbrp10le", 0.002),
    ];
    for (size, how, tolerance) in cases {
        let input = format!("-pix_fmt rgb24 -s {}x{} -r 25", size[1], size[0]);
        encode(&file, &input, &frames(size), &format!("-vf {how} -c:v ffv1"));
        for (i, color) in FRAMES.iter().enumerate() {
            let read = read(&file, i, &COLORS).unwrap();
            assert_eq!([read.height, read.width], size, "{how}");
            assert_color(&read, *color, tolerance, how);
        }
    }
}

/// Frames are the same in any order, from several threads and of a file that is replaced.
#[test]
fn frames_are_found_in_any_order() {
    if is_missing() {
        return;
    }
    let here = tempfile::tempdir().unwrap();
    let file = here.path().join("a.mkv");
    let input = "-pix_fmt rgb24 -s 16x16 -r 25";
    encode(&file, input, &frames([16, 16]), "-c:v ffv1 -pix_fmt bgr0");
    assert_eq!((video::count(&file).unwrap(), video::size(&file).unwrap()), (4, [16, 16]));
    for i in [3, 0, 2, 2, 1, 3, 3, 0] {
        assert_color(&read(&file, i, &COLORS).unwrap(), FRAMES[i], 0.002, "one thread");
    }
    (0..64usize).into_par_iter().for_each(|i| {
        let i = i * 7 % 4;
        assert_color(&read(&file, i, &COLORS).unwrap(), FRAMES[i], 0.002, "many threads");
    });
    let error = read(&file, 4, &COLORS).map(|_| ()).unwrap_err();
    assert_eq!(ErrorData::of(&error).code, "corrupt/no-such-frame");
    let parts = [0, 1, 1].map(|i| stored_parts(&file, i).unwrap());
    assert!(parts[0] != parts[1] && parts[1] == parts[2]);

    let other: Vec<u8> = [10, 20, 30].repeat(3 * 256);
    encode(&file, input, &other, "-c:v ffv1 -pix_fmt bgr0");
    assert_eq!(video::count(&file).unwrap(), 3);
    assert_color(&read(&file, 1, &COLORS).unwrap(), [10, 20, 30], 0.002, "replaced");
}

#[test]
fn depths_have_the_values_of_their_bits() {
    if is_missing() {
        return;
    }
    let here = tempfile::tempdir().unwrap();
    let file = here.path().join("a.mkv");
    let bytes: Vec<u8> = (0..=255).collect();
    encode(&file, "-pix_fmt gray -s 16x16 -r 25", &bytes, "-c:v ffv1 -pix_fmt gray");
    let GrayValues { height, width, kind, values, .. } = stored(&file, 0).unwrap();
    assert_eq!((height, width, kind), (16, 16, Kind::Bytes));
    let off = values.iter().zip(&bytes).map(|(v, b)| (v - f32::from(*b)).abs()).fold(0.0, f32::max);
    assert!(off <= 1.0, "{off}");
    let words: Vec<u8> = (0..256u16).flat_map(|i| (i * 257).to_le_bytes()).collect();
    encode(&file, "-pix_fmt gray16le -s 16x16 -r 25", &words, "-c:v ffv1 -pix_fmt gray16le");
    let GrayValues { kind, values, .. } = stored(&file, 0).unwrap();
    assert_eq!(kind, Kind::Words);
    let off = values.iter().enumerate().map(|(i, v)| (v - 257.0 * i as f32).abs()).fold(0.0, f32::max);
    assert!(off < 40.0, "{off} of 65535");
}

/// Transparency is composited over black in linear light, in codecs that store it in two ways.
#[test]
fn transparency_is_over_black() {
    if is_missing() {
        return;
    }
    let here = tempfile::tempdir().unwrap();
    let samples: Vec<u8> = [255, 255, 255, 128].repeat(64 * 64 * 2);
    for (name, options, tolerance) in [
        ("a.mov", "-c:v png -pix_fmt rgba", 0.002),
        ("a.mkv", "-c:v ffv1 -pix_fmt yuva444p -vf scale=out_color_matrix=bt601:out_range=tv", 0.02),
        ("a.webm", "-c:v libvpx-vp9 -pix_fmt yuva420p -lossless 1 -vf scale=out_color_matrix=bt601:out_range=tv", 0.03),
    ] {
        let file = here.path().join(name);
        encode(&file, "-pix_fmt rgba -s 64x64 -r 25", &samples, options);
        let read = read(&file, 1, &COLORS).unwrap();
        let worst = read.planes.iter().flatten().map(|v| (v - 128.0 / 255.0).abs()).fold(0.0, f32::max);
        assert!(worst < tolerance, "{name}: {}", read.planes[0][0]);
    }
}

#[test]
fn what_has_no_video_of_known_light_is_refused() {
    if is_missing() {
        return;
    }
    let here = tempfile::tempdir().unwrap();
    let at = |name: &str| here.path().join(name);
    let code = |file: &Path| ErrorData::of(&read(file, 0, &COLORS).map(|_| ()).unwrap_err()).code;
    let input = "-pix_fmt rgb24 -s 16x16 -r 25";
    let tagged = |name: &str, tags: &str| {
        encode(&at(name), input, &frames([16, 16]), &format!("-c:v ffv1 -pix_fmt yuv444p {tags}"));
        code(&at(name))
    };
    assert_eq!(tagged("hdr.mkv", "-color_trc smpte2084 -colorspace bt709"), "corrupt/video-hdr");
    assert_eq!(tagged("wide.mkv", "-colorspace bt2020nc"), "corrupt/video-matrix");
    std::fs::write(at("noise.mp4"), [7; 5000]).unwrap();
    assert_eq!(code(&at("noise.mp4")), "corrupt/video-undecoded");
    std::fs::write(at("empty.mp4"), []).unwrap();
    assert_eq!(code(&at("empty.mp4")), "corrupt/video-undecoded");
    let options = "-f lavfi -i sine=duration=1 -c:a pcm_s16le";
    let sound = at("sound.mkv");
    let made =
        Command::new("ffmpeg").args(["-y", "-v", "error"]).args(options.split(' ')).arg(&sound).status().unwrap();
    assert!(made.success());
    assert_eq!(code(&sound), "corrupt/no-video");

    // A file that is cut short has the frames before the cut.
    let mut random = fastrand::Rng::with_seed(3);
    let noise: Vec<u8> = (0..40 * 64 * 64 * 3).map(|_| random.u8(..)).collect();
    encode(&at("a.mkv"), "-pix_fmt rgb24 -s 64x64 -r 25", &noise, "-c:v ffv1 -pix_fmt bgr0");
    let whole = std::fs::read(at("a.mkv")).unwrap();
    std::fs::write(at("cut.mkv"), &whole[..whole.len() / 2]).unwrap();
    let first = read(&at("cut.mkv"), 0, &COLORS).unwrap();
    let exact = srgb_to_linear(f64::from(noise[0]) / 255.0) as f32;
    assert!((first.planes[0][0] - exact).abs() < 0.01, "{} {exact}", first.planes[0][0]);
    assert!(read(&at("cut.mkv"), 39, &COLORS).is_err());
}

/// Files of random bytes and damaged files end in an error or in frames.
#[test]
fn damaged_files_never_hang() {
    if is_missing() {
        return;
    }
    let here = tempfile::tempdir().unwrap();
    let file = here.path().join("a.mkv");
    encode(&file, "-pix_fmt rgb24 -s 16x16 -r 25", &frames([16, 16]), "-c:v ffv1 -pix_fmt bgr0");
    let whole = std::fs::read(&file).unwrap();
    let mut random = fastrand::Rng::with_seed(5);
    for i in 0..12 {
        let mut bytes = whole.clone();
        for _ in 0..20 {
            let at = random.usize(..bytes.len());
            bytes[at] = random.u8(..);
        }
        let damaged = here.path().join(format!("{i}.mkv"));
        std::fs::write(&damaged, bytes).unwrap();
        if let Ok(read) = read(&damaged, 2, &COLORS) {
            assert!(read.planes.iter().flatten().all(|v| (0.0..=1.0).contains(v)));
        }
    }
}
