//! Tests an SLM that is a part of its video frame.

use super::*;

/// Returns the video frames of a display whose SLM is all of the frame, placed in larger frames by hand.
fn placed(frames: &VideoFrames, [height, width]: [usize; 2], [top, left]: [usize; 2], fill: u8) -> Vec<u8> {
    let channels = frames.channels;
    let mut all = vec![fill; frames.count() * height * width * channels];
    for (i, out) in all.chunks_mut(height * width * channels).enumerate() {
        for (y, row) in frames.frame(i).chunks(frames.width * channels).enumerate() {
            out[((top + y) * width + left) * channels..][..row.len()].copy_from_slice(row);
        }
    }
    all
}

#[test]
fn hamamatsu_s_columns_are_the_first_of_its_video_frame() {
    let here = here();
    for preset in ["hamamatsu-x13138", "hamamatsu-x15213"] {
        let display = Display::preset(preset).unwrap();
        assert_eq!([display.height, display.width], [1024, 1272]);
        let phases = vec![noise(1024 * 1272, 9)];
        let frames = encode(&display, &[Color::Green], 1, &phases);
        assert_eq!([frames.height, frames.width, frames.channels], [1024, 1280, 1]);
        let mut plain = display.clone();
        plain.encoding.active_area = None;
        let plain = encode(&plain, &[Color::Green], 1, &phases);
        assert!(frames.bytes() == placed(&plain, [1024, 1280], [0, 0], 0));
        let decode = |frames: &VideoFrames| {
            let decoder = Decoder::new(&display, &[Color::Green], 1, AsShown::default()).unwrap();
            decoder.decode(frames, |i| i.to_string()).unwrap()
        };
        let decoded = decode(&frames);
        assert!(encode(&display, &[Color::Green], 1, &decoded) == frames);
        // The other columns may have any light.
        let mut lit = frames.clone();
        lit.bytes_mut().chunks_mut(1280).for_each(|row| row[1272..].fill(77));
        assert!(decode(&lit) == decoded);
        // The maker's correction has the size of the SLM.
        let file = here.path().join("correction.bmp");
        let level = |x: u32, y: u32| image::Luma([((x * 7 + y * 3) % 256) as u8]);
        image::GrayImage::from_fn(1272, 1024, level).save(&file).unwrap();
        let mut corrected = display.clone();
        corrected.encoding.correction = vec![crate::optics::Correction {
            file,
            sign: 1,
            color: None,
            two_pi_level: None,
            orientation: crate::optics::Orientation::Slm,
        }];
        let zeros = [vec![0.0; 1024 * 1272]];
        let frames = encode(&corrected, &[Color::Green], 1, &zeros);
        for (y, row) in frames.frame(0).chunks(1280).enumerate() {
            for (x, level) in row.iter().enumerate() {
                let wanted = if x < 1272 { (x * 7 + y * 3) % 256 } else { 0 };
                assert_eq!(usize::from(*level), wanted, "{y}, {x}");
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Any packing, flip and offset in a larger frame is the same picture surrounded by the fill.
    #[test]
    fn an_area_is_the_whole_picture_in_a_larger_one(
        h in 1usize..9, w in 1usize..70, around in prop::array::uniform4(0usize..9), fill: u8, packing in 0usize..5,
        flip in 0usize..4,
    ) {
        let (packing, levels) = [
            ("packing = \"grey8\"\n", 256),
            ("packing = \"fields\"\n", 200),
            ("packing = \"planes24\"\n", 2),
            ("packing = \"planes24\"\ncells = [[1, 3], [0, 2]]\n", 16),
            ("packing = \"planes8\"\nchannel = \"green\"\ncells = [[1, 2, 0]]\n", 8),
        ][packing];
        let flip = ["none", "horizontal", "vertical", "both"][flip];
        let [top, below, left, right] = around;
        let here = here();
        let plain = with(&format!("{packing}flip_video = \"{flip}\"\n"), here.path(), [h, w], levels);
        let [rows, columns] = plain.encoding.area_size([h, w]);
        let size = [top + rows + below, left + columns + right];
        let area = format!(
            "active_area = {{ video_size = {size:?}, offset = [{top}, {left}], fill = {fill} }}\n{packing}\
             flip_video = \"{flip}\"\n"
        );
        let display = with(&area, here.path(), [h, w], levels);
        let n = if packing.contains("planes") { 8 } else { 1 };
        let phases = sets(3, n * h * w);
        let frames = encode(&display, &ALL, n, &phases);
        prop_assert_eq!([frames.height, frames.width], size);
        let whole = encode(&plain, &ALL, n, &phases);
        prop_assert!(frames.bytes() == placed(&whole, size, [top, left], fill));
        let decode = |display: &Display, frames: &VideoFrames| {
            Decoder::new(display, &ALL, n, AsShown::default()).unwrap().decode(frames, |i| i.to_string()).unwrap()
        };
        prop_assert!(decode(&display, &frames) == decode(&plain, &whole));
    }
}

#[test]
fn an_area_that_does_not_fit_is_refused() {
    let head = "resolution = [4, 6]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n";
    let read = |area: &str| Display::from_toml(&format!("{head}[encoding]\nactive_area = {area}\n"), "b");
    for (area, code) in [
        ("{ video_size = [4, 5] }", "display-file/active-area"),
        ("{ video_size = [5, 6], offset = [2, 0] }", "display-file/active-area"),
        ("{ video_size = [4, 6], offset = [0, 9223372036854775807] }", "display-file/active-area"),
        ("{ video_size = [0, 6] }", "display-file/video-size"),
        ("{ video_size = [4, 65537] }", "display-file/video-size"),
        ("{ video_size = [4, 6], fill = 256 }", "display-file/toml"),
        ("{ offset = [0, 0] }", "display-file/toml"),
    ] {
        let error = read(area).unwrap_err();
        assert_eq!(ErrorData::of(&error).code, code, "{area}: {error}");
    }
    let display = read("{ video_size = [8, 8], offset = [4, 2] }").unwrap();
    assert_eq!(Display::from_toml(&display.to_toml(), "b").unwrap().encoding, display.encoding);
    // A size that the caller gives is checked, too.
    let larger = Display { height: 5, ..display.clone() };
    let error = Encoder::new(&larger, &[Color::Green], 1).unwrap_err();
    assert_eq!(ErrorData::of(&error).code, "display/active-area", "{error}");
    assert_eq!(display.encoding.most_pixels(), Some([4, 6]));
}

/// Holograms of all columns of the video frame, which these presets had before, still fill it.
#[test]
fn a_hologram_as_large_as_the_video_frame_is_shown() {
    let preset = Display::preset("hamamatsu-x15213").unwrap();
    let shown = |width: usize| {
        let color = crate::hologram::ColorHologram {
            color: Some(Color::Green),
            wavelength: 520e-9,
            exposure: 1.0,
            efficiency: 1.0,
            phases: Vec::new(),
        };
        let display = Display { width, ..preset.clone() };
        crate::hologram::Hologram::on(&display, 1, vec![color]).shown_on(None).unwrap()
    };
    assert_eq!([640, 1272, 1280].map(|width| shown(width).width), [640, 1272, 1280]);
    let encoder = Encoder::new(&shown(1280), &[Color::Green], 1).unwrap();
    assert_eq!((encoder.video_shape(), encoder.hologram_size()), ([1, 1024, 1280, 1], [1024, 1280]));
    // A larger one does not fit, and the display keeps its own size.
    assert_eq!(shown(1281).width, 1272);
}
