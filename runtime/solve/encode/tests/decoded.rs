//! Tests that the decoder is the inverse of the encoder, and refuses frames that no encoder made.

use super::*;
use crate::encoded::{Encoded, is_encoded};
use crate::optics::PRESETS;
use eyebox_base::error::ErrorData;

/// Returns colors and sub-frames that fill one set of a display.
fn set_of(display: &Display) -> (Vec<Color>, usize) {
    let colors: Vec<Color> = display.wavelengths.iter().map(|w| w.color).collect();
    let packed = [1, 8, 24].into_iter().find_map(|n| Packed::new(&display.encoding, &colors, n).ok());
    (colors, packed.expect("a set").sub_frames)
}

/// Checks that decoded phases equal the encoded ones within the widest step of the levels, and encode to the same
/// bytes.
fn check(display: &Display, widest_turns: f64) {
    let (colors, n) = set_of(display);
    let decoder = Decoder::new(display, &colors, n, AsShown::default()).unwrap_or_else(|e| panic!("{e}"));
    let [h, w] = decoder.size();
    let phases = sets(colors.len(), n * h * w);
    let frames = encode(display, &colors, n, &phases);
    let decoded = decoder.decode(&frames, |i| i.to_string()).unwrap_or_else(|e| panic!("{}: {e}", display.name));
    for (phase, decoded) in phases.iter().flatten().zip(decoded.iter().flatten()) {
        let off = (f64::from(*phase) - f64::from(*decoded)) / TAU;
        let off = (off - off.round()).abs();
        assert!(off <= widest_turns / 2.0 + 1e-5, "{}: {phase} became {decoded}", display.name);
    }
    assert_eq!(encode(display, &colors, n, &decoded), frames, "{}", display.name);
}

#[test]
fn every_preset_is_undone() {
    for name in PRESETS {
        let display = display(name, 6, 10);
        let widest = if name.contains("plm") { 0.17 } else { 1.0 / f64::from(display.levels) };
        check(&display, widest);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Tests every packing, with every rotation, gratings, and corrections in either orientation.
    #[test]
    fn every_packing_turn_grating_and_correction_is_undone(
        h in 1usize..7, w in 1usize..20, packing in 0usize..6, flip in 0usize..4, quarter in 0u32..4,
        offset in prop::array::uniform2(-20i32..20), period in 2.0f64..9.0, direction in 0.0f64..360.0,
        slm: bool, mirrored: bool,
    ) {
        let here = here();
        let (packing, levels) = [
            ("packing = \"grey8\"\ntwo_pi_level = { red = 218, green = 190.5, blue = 256 }\n", 256),
            ("packing = \"fields\"\nchannel_order = \"gbr\"\n", 200),
            ("packing = \"planes8\"\nchannel = \"blue\"\n", 2),
            ("packing = \"planes24\"\nchannel_order = \"grb\"\n", 2),
            ("packing = \"planes24\"\ncells = [[1, 3], [0, 2]]\n\
              codes = [3, 2, 1, 7, 0, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12]\n", 16),
            ("packing = \"grey8\"\nlook_up = { red = \"t.csv\", green = \"t.csv\", blue = \"t.csv\" }\n", 256),
        ][packing];
        let rows: String = (0..=255).map(|l| format!("{l};{}\n", 1.2 * f64::from(l) / 255.0)).collect();
        std::fs::write(here.path().join("t.csv"), format!("level;phase (2 pi)\n{rows}")).unwrap();
        let flip = ["none", "horizontal", "vertical", "both"][flip];
        let size = if !slm && quarter % 2 == 1 { [w, h] } else { [h, w] };
        let extra: Vec<f32> = (0..h * w).map(|i| (i % 13) as f32 * 0.7).collect();
        crate::files::write_npy(&here.path().join("c.npy"), &size, &extra).unwrap();
        let video = if mirrored { "horizontal" } else { "vertical" };
        let text = format!(
            "{packing}flip = \"{flip}\"\nrotation_deg = {}\noffset_px = {offset:?}\nflip_video = \"{video}\"\n\
             [[encoding.correction]]\nfile = \"c.npy\"\nsign = -1\norientation = \"{}\"\n\
             [[encoding.grating]]\nperiod_px = {period}\ndirection_deg = {direction}\ncolor = \"green\"\n",
            90 * quarter, if slm { "slm" } else { "hologram" },
        );
        let display = with(&text, here.path(), [h, w], levels);
        check(&display, 1.0 / f64::from(levels.min(190)));
    }
}

/// Steps that stay are on the SLM's pixels.
#[test]
fn what_is_left_is_what_the_slm_shows() {
    let here = here();
    let text = "flip = \"horizontal\"\nrotation_deg = 90\noffset_px = [1, 2]\n\
                [[encoding.grating]]\nperiod_px = 8\ndirection_deg = 0\n";
    let display = with(text, here.path(), [4, 6], 256);
    let phases = sets(1, 24);
    let frames = encode(&display, &ALL[..1], 1, &phases);
    let decode = |left: AsShown| {
        let decoder = Decoder::new(&display, &ALL[..1], 1, left).unwrap();
        (decoder.size(), decoder.decode(&frames, |i| i.to_string()).unwrap().remove(0))
    };
    let mut left = AsShown::default();
    assert!(left.leave("all") && !left.leave("everything"));
    let (size, shown) = decode(left);
    assert_eq!(size, [4, 6]);
    for (phase, level) in shown.iter().zip(frames.frame(0)) {
        assert!(is_nearest(*level, *phase, even(256), 256));
    }
    let mut left = AsShown::default();
    assert!(left.leave("gratings"));
    let (size, tilted) = decode(left);
    assert_eq!(size, [6, 4]);
    for (i, (tilted, plain)) in tilted.iter().zip(decode(AsShown::default()).1).enumerate() {
        let off = f64::from(tilted - plain) / TAU - (i % 4) as f64 / 8.0;
        assert!((off - off.round()).abs() < 1e-6, "{i}: {off}");
    }
}

#[test]
fn what_no_encoder_made_is_said() {
    let refused = |display: &Display, colors: &[Color], n: usize, at: usize, byte: u8| {
        let decoder = Decoder::new(display, colors, n, AsShown::default()).unwrap();
        let mut frames = decoder.encoder().frames();
        frames.bytes_mut()[at] = byte;
        match decoder.decode(&frames, |i| format!("frame {i}")).unwrap_err() {
            EncodeError::Frame { frame, reason } => (frame, reason),
            other => panic!("{other}"),
        }
    };
    let sixteen = Display { levels: 16, ..display("grey8", 2, 3) };
    let (frame, said) = refused(&sixteen, &ALL[..2], 1, 6 + 4, 16);
    assert_eq!(
        (&frame[..], said.code(), &numbers(said.text())[..]),
        ("frame 1", "no-level", &["0", "16", "1", "1"][..])
    );
    assert!(said.text().contains("green"), "{said}");
    let (frame, said) = refused(&display("fields", 2, 3), &ALL[..1], 1, 3 * 4 + 1, 128);
    assert_eq!((&frame[..], said.code(), &numbers(said.text())[..]), ("frame 0", "lit-bit", &["7", "1", "1"][..]));
    assert!(said.text().contains("green"), "{said}");
    let decoder = Decoder::new(&sixteen, &ALL, 1, AsShown::default()).unwrap();
    let other = Encoder::new(&sixteen, &ALL[..1], 1).unwrap().frames();
    assert!(decoder.decode(&other, |i| i.to_string()).is_err());
}

/// A folder is complete. The hologram returns with its exposure, and the file of the display is no longer needed.
#[test]
fn a_folder_holds_all_that_is_needed() {
    let here = here();
    std::fs::write(here.path().join("t.csv"), "level,phase_turns\n0,0\n1,0.25\n2,0.5\n3,0.75\n").unwrap();
    crate::files::write_npy(&here.path().join("c.npy"), &[5, 4], &[0.3; 20]).unwrap();
    let text = "rotation_deg = 90\nlook_up = { green = \"t.csv\", blue = \"t.csv\" }\n\
                [[encoding.correction]]\nfile = \"c.npy\"\nsign = 1\n";
    let display = with(text, here.path(), [4, 5], 4);
    let phases = sets(2, 2 * 20);
    let encoder = Encoder::new(&display, &ALL[1..], 2).unwrap();
    let frames = encode(&display, &ALL[1..], 2, &phases);
    let color = |color, wavelength, exposure| crate::hologram::ColorHologram {
        color: Some(color),
        wavelength,
        exposure,
        efficiency: 0.5,
        phases: Vec::new(),
    };
    let colors = vec![color(Color::Green, 520e-9, 0.25), color(Color::Blue, 440e-9, 0.75)];
    let of =
        crate::hologram::Hologram { scene: "a scene".into(), ..crate::hologram::Hologram::on(&display, 2, colors) };
    let folder = here.path().join("frames");
    encoder.save(&frames, Some(&of), &folder).unwrap();
    for name in ["t.csv", "c.npy", "display.toml"] {
        std::fs::remove_file(here.path().join(name)).ok();
    }
    assert!(is_encoded(&folder) && !is_encoded(here.path()));
    let encoded = Encoded::open(&folder, None, None).unwrap();
    let seen = encoded.decode(AsShown::default()).unwrap();
    assert!(!seen.metadata.exposure_assumed);
    assert_eq!((seen.height, seen.width, seen.frames, &seen.scene[..]), (5, 4, 2, "a scene"));
    assert_eq!(seen.colors.iter().map(|c| c.exposure).collect::<Vec<_>>(), [0.25, 0.75]);
    assert_eq!((seen.pitch, seen.focal_length), (of.pitch, of.focal_length));
    let again: Vec<Vec<f32>> = seen.colors.into_iter().map(|c| c.phases).collect();
    let kept = Display::load(folder.join("display.toml").to_str().unwrap()).unwrap();
    assert_eq!(encode(&kept, &ALL[1..], 2, &again), frames);
    // A second write replaces it, and is refused if it holds a file of the user.
    encoder.save(&frames, None, &folder).unwrap_err();
    let encoder = Encoder::new(&kept, &ALL[1..], 2).unwrap();
    encoder.save(&frames, None, &folder).unwrap();
    assert!(Encoded::open(&folder, None, None).unwrap().decode(AsShown::default()).unwrap().metadata.exposure_assumed);
    std::fs::write(folder.join("notes.txt"), "mine").unwrap();
    let error = encoder.save(&frames, None, &folder).unwrap_err();
    assert_eq!(ErrorData::of(&error).code, "file/taken/holds-something-else", "{error}");
}

/// Pictures of any origin are in the order of their numbers, in gray or color, and refused if they do not fit.
#[test]
fn pictures_of_any_origin_are_decoded() {
    let here = here();
    let folder = here.path().join("mine");
    std::fs::create_dir(&folder).unwrap();
    for (name, level) in [("h_9.png", 9u8), ("h_10.png", 10), ("h_11.png", 11)] {
        let grey = image::GrayImage::from_pixel(3, 2, image::Luma([level]));
        let grey = image::DynamicImage::ImageLuma8(grey);
        if level == 10 { grey.to_rgb8().save(folder.join(name)) } else { grey.save(folder.join(name)) }.unwrap();
    }
    let slm = display("grey8", 2, 3);
    let seen = Encoded::open(&folder, Some(&slm), None).unwrap();
    let described = seen.describe();
    assert!(numbers(&described) == ["3", "1"] && described.contains("red, green, blue"), "{described}");
    let seen = seen.decode(AsShown::default()).unwrap();
    for (c, level) in seen.colors.iter().zip([9.0, 10.0, 11.0]) {
        assert!(c.phases.iter().all(|p| (f64::from(*p) - level / 256.0 * TAU).abs() < 1e-6));
    }
    let green = Encoded::open(&folder, Some(&slm), Some(Color::Green)).unwrap().decode(AsShown::default()).unwrap();
    assert_eq!((green.frames, green.colors.len()), (3, 1));
    let one = Encoded::open(&folder.join("h_9.png"), Some(&slm), Some(Color::Red)).unwrap();
    assert_eq!(one.decode(AsShown::default()).unwrap().frames, 1);
    let refused = |path: &std::path::Path, display: Option<&Display>, color, code: &str, holds: &str| {
        let seen = Encoded::open(path, display, color).and_then(|e| e.decode(AsShown::default()));
        let said = seen.expect_err("refused");
        assert_eq!(ErrorData::of(&said).code, code, "{said}");
        assert!(said.to_string().contains(holds), "{said}");
        said.to_string()
    };
    refused(&folder, None, None, "frame/no-display", "`display`");
    refused(here.path(), Some(&slm), None, "frame/no-png", "");
    refused(&folder, Some(&display("grey8", 4, 6)), None, "file/content/frame-size", "`size` 2x3");
    std::fs::copy(folder.join("h_9.png"), folder.join("h_12.png")).unwrap();
    refused(&folder, Some(&slm), None, "frame/video-frames", "`color`");
    image::RgbImage::from_pixel(3, 2, image::Rgb([1, 2, 1])).save(folder.join("h_12.png")).unwrap();
    let said = refused(&folder, Some(&slm), Some(Color::Red), "file/content/frame-colored", "");
    assert_eq!(numbers(&said), ["0", "0"], "{said}");
    image::RgbaImage::from_pixel(3, 2, image::Rgba([1, 1, 1, 9])).save(folder.join("h_12.png")).unwrap();
    refused(&folder, Some(&slm), Some(Color::Red), "file/content/not-opaque", "");
}
