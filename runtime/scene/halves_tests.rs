//! Tests pictures and videos that have colors in one half and depths in the other one.

use crate::{LightField, Near, Request, SceneError, load, sequence};
use eyebox_base::error::ErrorData;
use eyebox_optics::{Color, Display};
use std::path::Path;

const SIZE: [usize; 2] = [24, 32];

fn display() -> Display {
    Display { height: 48, width: 64, ..Display::preset("headset").unwrap() }
}

/// Returns colors and depths of a scene as bytes, (row, column, channel) and (row, column). The depths have both ends,
/// because a map of a video has a fixed range.
fn colors_and_depths() -> (Vec<u8>, Vec<u8>) {
    let pixels = || (0..SIZE[0]).flat_map(|y| (0..SIZE[1]).map(move |x| (y, x)));
    let colors = pixels().flat_map(|(y, x)| [(x * 8) as u8, (y * 10) as u8, ((x + y) * 4) as u8]).collect();
    (colors, pixels().map(|(y, x)| if (x / 8 + y / 8) % 2 == 0 { 0 } else { 255 }).collect())
}

/// Joins rows of two pictures of three channels, side by side or one below the other.
fn joined(first: &[u8], second: &[u8], is_beside: bool) -> (Vec<u8>, [usize; 2]) {
    let row = 3 * SIZE[1];
    match is_beside {
        true => {
            let rows = first.chunks(row).zip(second.chunks(row));
            (rows.flat_map(|(a, b)| [a, b].concat()).collect(), [SIZE[0], 2 * SIZE[1]])
        }
        false => ([first, second].concat(), [2 * SIZE[0], SIZE[1]]),
    }
}

fn save(path: &Path, bytes: &[u8], [rows, columns]: [usize; 2], is_color: bool) {
    let kind = if is_color { image::ColorType::Rgb8 } else { image::ColorType::L8 };
    image::save_buffer(path, bytes, columns as u32, rows as u32, kind).unwrap();
}

fn loaded(source: &str, map: Option<&Path>) -> Result<LightField, SceneError> {
    let display = display();
    let request = Request {
        views: 3,
        depth_map: map,
        near: Some(Near::Bright),
        depth: Some([-0.8e-3, 0.8e-3]),
        ..Request::new(&display, &[Color::Red, Color::Green, Color::Blue])
    };
    load(source, &request)
}

#[test]
fn either_half_of_a_picture_has_the_depths() {
    let here = tempfile::tempdir().unwrap();
    let at = |name: &str| here.path().join(name);
    let (colors, depths) = colors_and_depths();
    save(&at("colors.png"), &colors, SIZE, true);
    save(&at("depths.png"), &depths, SIZE, false);
    let gray: Vec<u8> = depths.iter().flat_map(|d| [*d; 3]).collect();
    let wanted = loaded(at("colors.png").to_str().unwrap(), Some(&at("depths.png"))).unwrap();
    for (half, is_beside, is_first) in
        [("right", true, false), ("left", true, true), ("bottom", false, false), ("top", false, true)]
    {
        let (first, second) = if is_first { (&gray, &colors) } else { (&colors, &gray) };
        let (bytes, size) = joined(first, second, is_beside);
        save(&at("both.png"), &bytes, size, true);
        let source = format!("{}?depth={half}", at("both.png").display());
        let field = loaded(&source, None).unwrap();
        assert_eq!((&field.planes, field.depth), (&wanted.planes, wanted.depth), "{half}");
        let other = format!("{}?half={half}", at("both.png").display());
        assert!(matches!(loaded(&other, None), Err(SceneError::NoDepthMap { .. })), "{half}");
        let error = loaded(&source, Some(&at("depths.png"))).map(|_| ()).unwrap_err();
        assert_eq!(ErrorData::of(&error).code, "options/two-maps");
    }
    let error = loaded(&format!("{}?depth=middle", at("both.png").display()), None).map(|_| ()).unwrap_err();
    assert_eq!(ErrorData::of(&error).code, "options/half");
}

/// The frames of a video in both formats show the same as its pictures.
#[test]
fn a_video_has_the_depths_in_a_half() {
    let here = tempfile::tempdir().unwrap();
    let at = |name: &str| here.path().join(name);
    let (colors, depths) = colors_and_depths();
    let gray: Vec<u8> = depths.iter().flat_map(|d| [*d; 3]).collect();
    save(&at("colors.png"), &colors, SIZE, true);
    save(&at("depths.png"), &depths, SIZE, false);
    let wanted = loaded(at("colors.png").to_str().unwrap(), Some(&at("depths.png"))).unwrap();
    let (bytes, size) = joined(&colors, &gray, true);
    for i in 0..3 {
        save(&at(&format!("f{i}.png")), &bytes, size, true);
    }
    let mut made = vec![];
    for (name, options) in [("a.mkv", "-c:v ffv1 -pix_fmt bgr0"), ("b.mp4", "-c:v mpeg4 -q:v 1 -pix_fmt yuv420p")] {
        let run = std::process::Command::new("ffmpeg")
            .args(["-y", "-v", "error", "-framerate", "25", "-i", at("f%d.png").to_str().unwrap()])
            .args(options.split(' '))
            .arg(at(name))
            .status();
        match run {
            Ok(status) => assert!(status.success(), "{name}"),
            Err(_) => eprintln!("ffmpeg is missing: skipped"),
        }
        made.extend(at(name).exists().then(|| at(name)));
    }
    for file in made {
        let frames = sequence(&format!("{}?depth=right", file.display()), &[]).unwrap().unwrap();
        assert_eq!(frames.len(), 3);
        assert!(frames[2].ends_with("?depth=right&frame=2"), "{}", frames[2]);
        let field = loaded(&frames[2], None).unwrap();
        let off = field.planes.iter().flatten().flatten().zip(wanted.planes.iter().flatten().flatten());
        let error: f32 = off.map(|(a, b)| (a - b).powi(2)).sum::<f32>() / wanted.planes[0].concat().len() as f32;
        let is_exact = file.extension().unwrap() == "mkv";
        assert!(error < if is_exact { 2e-3 } else { 3e-2 }, "{}: {error}", file.display());
    }
}
