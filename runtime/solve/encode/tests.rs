//! Tests every packing with a decoder that shares nothing with the encoder.
//!
//! It knows presets by their description, and levels by float64.

#[cfg(feature = "image-formats")]
mod active_area;
mod beyond_a_turn;
#[cfg(feature = "image-formats")]
mod calibrated;
#[cfg(feature = "image-formats")]
mod decoded;
mod many_bits;
mod turned;

use super::*;
use crate::optics::{Color, Display};
use eyebox_base::error::ErrorData;
use proptest::prelude::*;
use std::{f32, f64::consts::TAU};

const ALL: [Color; 3] = [Color::Red, Color::Green, Color::Blue];
/// Phases whose level is easily wrong.
const EDGES: [f32; 14] = [
    0.0,
    -0.0,
    f32::consts::TAU.next_down(),
    f32::consts::TAU.next_up(),
    -f32::consts::TAU,
    -1e-8,
    -0.7,
    -f32::consts::PI,
    f32::consts::PI,
    1e6,
    -1e6,
    12_345.678,
    1e-30,
    0.0123,
];

/// Returns the numbers of a sentence in their order.
pub(crate) fn numbers(text: &str) -> Vec<&str> {
    let words = text.split(|c: char| !c.is_alphanumeric() && c != '.').map(|word| word.trim_end_matches('.'));
    words.filter(|word| word.starts_with(|c: char| c.is_ascii_digit()) && word.parse::<f64>().is_ok()).collect()
}

fn noise(count: usize, seed: u64) -> Vec<f32> {
    let mut random = crate::solve::SplitMix(seed);
    let mut draw = |i: usize| match i % 5 {
        0 => EDGES[(random.unit() * 14.0) as usize],
        _ => ((random.unit() - 0.5) * 30.0) as f32,
    };
    (0..count).map(&mut draw).collect()
}

fn sets(colors: usize, count: usize) -> Vec<Vec<f32>> {
    (0..colors).map(|c| noise(count, 77 + c as u64)).collect()
}

fn slices(phases: &[Vec<f32>]) -> Vec<&[f32]> {
    phases.iter().map(|p| &p[..]).collect()
}

fn display(preset: &str, height: usize, width: usize) -> Display {
    Display { height, width, ..Display::preset(preset).unwrap() }
}

fn encode(display: &Display, colors: &[Color], sub_frames: usize, phases: &[Vec<f32>]) -> VideoFrames {
    let encoder = Encoder::new(display, colors, sub_frames).unwrap_or_else(|e| panic!("{e}"));
    let slices = slices(phases);
    let set = PhaseSet::new(&slices, encoder.hologram_size()).unwrap();
    // Earlier bytes must not matter.
    let mut frames = encoder.frames();
    frames.bytes_mut().fill(0xa5);
    encoder.encode_into(&set, &mut frames).unwrap();
    frames
}

/// Returns true if `level` is the nearest of `count` over `two_pi`, or within 2^-20 turns of the nearest.
fn is_nearest(level: u8, phase: f32, turns_of: impl Fn(u8) -> f64, count: u32) -> bool {
    let far = |l: u8| {
        let off = f64::from(phase) / TAU - turns_of(l);
        (off - off.round()).abs()
    };
    let best = (0..count).map(|l| far(l as u8)).fold(1.0, f64::min);
    u32::from(level) < count && far(level) <= best + 1e-6
}

fn even(count: u32) -> impl Fn(u8) -> f64 {
    move |level| f64::from(level) / f64::from(count)
}

#[test]
fn edges_become_the_levels_that_arithmetic_says() {
    // The phases 0, just under 2 pi, 2 pi, half a level below and above 2 pi, negative, and a million radians.
    let step = TAU / 256.0;
    let phases: Vec<f32> = [0.0, TAU - 3e-7, TAU, TAU - 0.4 * step, TAU - 0.6 * step, -step, 0.6 * step, 1e6]
        .map(|p: f64| p as f32)
        .to_vec();
    let wanted = [0, 0, 0, 0, 255, 255, 1, ((1e6 / TAU).fract() * 256.0).round() as u8];
    let frames = encode(&display("grey8", 1, 8), &[Color::Green], 1, &[phases]);
    assert_eq!(frames.frame(0), wanted);
}

#[test]
fn grey8_is_undone() {
    for (h, w, colors, n) in
        [(5, 7, &ALL[..], 2), (33, 300, &ALL[1..2], 3), (1, 1, &ALL[..2], 1), (9, 2100, &ALL[..1], 1)]
    {
        let phases = sets(colors.len(), n * h * w);
        let frames = encode(&display("grey8", h, w), colors, n, &phases);
        assert_eq!((frames.count(), frames.channels, frames.height, frames.width), (n * colors.len(), 1, h, w));
        for f in 0..n {
            for (c, phases) in phases.iter().enumerate() {
                for (i, level) in frames.frame(f * colors.len() + c).iter().enumerate() {
                    let phase = phases[f * h * w + i];
                    assert!(is_nearest(*level, phase, even(256), 256), "{phase} became {level}");
                }
            }
        }
    }
}

#[test]
fn fields_are_undone() {
    for colors in [&ALL[..], &[Color::Blue], &[Color::Blue, Color::Red]] {
        let (h, w, n) = (6, 31, 2);
        let phases = sets(colors.len(), n * h * w);
        let frames = encode(&display("fields", h, w), colors, n, &phases);
        assert_eq!((frames.count(), frames.channels), (n, 3));
        for f in 0..n {
            for (i, pixel) in frames.frame(f).chunks(3).enumerate() {
                for (channel, level) in pixel.iter().enumerate() {
                    match colors.iter().position(|c| c.channel() == channel) {
                        Some(c) => assert!(is_nearest(*level, phases[c][f * h * w + i], even(256), 256)),
                        None => assert_eq!(*level, 0),
                    }
                }
            }
        }
    }
}

#[test]
fn planes8_are_undone() {
    let (h, w, n) = (5, 35, 16);
    let phases = sets(2, n * h * w);
    let frames = encode(&display("planes8", h, w), &ALL[1..], n, &phases);
    assert_eq!((frames.count(), frames.channels), (4, 1));
    for f in 0..n {
        for (c, phases) in phases.iter().enumerate() {
            for (i, byte) in frames.frame(f / 8 * 2 + c).iter().enumerate() {
                let level = byte >> (f % 8) & 1;
                assert!(is_nearest(level, phases[f * h * w + i], even(2), 2));
            }
        }
    }
}

#[test]
fn planes24_are_undone_in_either_order() {
    use crate::optics::ChannelOrder;
    let (h, w) = (4, 2050);
    for (order, channels) in [(ChannelOrder::Rgb, [0, 1, 2]), (ChannelOrder::Grb, [1, 0, 2])] {
        for (colors, n) in [(3, 8), (3, 16), (2, 12), (1, 48)] {
            let mut display = display("planes24", h, w);
            display.encoding.channel_order = order;
            let phases = sets(colors, n * h * w);
            let frames = encode(&display, &ALL[..colors], n, &phases);
            let per = 24 / colors;
            assert_eq!((frames.count(), frames.channels), (n / per, 3));
            for (c, phases) in phases.iter().enumerate() {
                for f in 0..n {
                    let plane = c * per + f % per;
                    for (i, pixel) in frames.frame(f / per).chunks(3).enumerate() {
                        let level = pixel[channels[plane / 8]] >> (plane % 8) & 1;
                        assert!(is_nearest(level, phases[f * h * w + i], even(2), 2));
                    }
                }
            }
        }
    }
}

/// The mirrors of TI's device in its table, as percent of the largest displacement, and the memory's code.
const MIRROR: [(f64, u8); 16] = [
    (0.0, 3),
    (1.07, 2),
    (2.19, 1),
    (4.50, 7),
    (5.98, 0),
    (7.75, 6),
    (12.06, 5),
    (18.5, 4),
    (36.55, 11),
    (39.55, 10),
    (45.1, 9),
    (52.44, 8),
    (63.93, 15),
    (71.16, 14),
    (85.02, 13),
    (100.0, 12),
];

#[test]
fn plm_is_undone_by_its_table() {
    for (h, w, colors, n) in [(3, 5, 3, 8), (1, 1, 1, 24), (7, 2051, 2, 12)] {
        let phases = sets(colors, n * h * w);
        let frames = encode(&display("plm", h, w), &ALL[..colors], n, &phases);
        assert_eq!((frames.count(), frames.height, frames.width, frames.channels), (1, 2 * h, 2 * w, 3));
        for (c, phases) in phases.iter().enumerate() {
            for f in 0..n {
                let plane = c * (24 / colors) + f;
                let bit = |row: usize, column: usize| {
                    // The frame was flipped left to right after everything else.
                    let at = row * 2 * w + (2 * w - 1 - column);
                    frames.frame(0)[3 * at + plane / 8] >> (plane % 8) & 1
                };
                for y in 0..h {
                    for x in 0..w {
                        let [m1, m3] = [bit(2 * y, 2 * x), bit(2 * y, 2 * x + 1)];
                        let [m0, m2] = [bit(2 * y + 1, 2 * x), bit(2 * y + 1, 2 * x + 1)];
                        let code = m0 | m1 << 1 | m2 << 2 | m3 << 3;
                        let level = MIRROR.iter().position(|m| m.1 == code).unwrap() as u8;
                        let phase = phases[(f * h + y) * w + x];
                        // The phase is rounded to 1/65536 of a turn.
                        let turns = |l: u8| MIRROR[usize::from(l)].0 / 100.0 * 15.0 / 16.0;
                        let far = |l: u8| {
                            let off = f64::from(phase) / TAU - turns(l);
                            (off - off.round()).abs()
                        };
                        let best = (0..16).map(far).fold(1.0, f64::min);
                        assert!(far(level) <= best + 2.0 / 65536.0, "{phase} became level {level}");
                    }
                }
            }
        }
    }
}

#[test]
fn every_level_of_the_plm_has_its_code() {
    let phases: Vec<f32> = MIRROR.iter().map(|m| (m.0 / 100.0 * 15.0 / 16.0 * TAU) as f32 + 1e-4).collect();
    let all: Vec<f32> = (0..24).flat_map(|_| phases.clone()).collect();
    let frames = encode(&display("plm", 1, 16), &[Color::Red], 24, &[all]);
    for (x, (_, code)) in MIRROR.iter().enumerate() {
        let bit = |row: usize, column: usize| frames.frame(0)[3 * (row * 32 + 31 - column)] & 1;
        let got = [bit(1, 2 * x), bit(0, 2 * x), bit(1, 2 * x + 1), bit(0, 2 * x + 1)];
        assert_eq!(got, [code & 1, code >> 1 & 1, code >> 2 & 1, code >> 3 & 1], "level {x}");
    }
}

/// The preset's file in `docs/displays.md` must equal the preset.
#[test]
fn the_documented_plm_is_the_preset() {
    let text = include_str!("../../../docs/displays.md");
    let block = text.split("```toml\n").last().and_then(|b| b.split("```").next()).expect("a file");
    let head = "resolution = [800, 1358]\npitch_um = 10.8\nfocal_length_mm = 400.0\nlevels = 16\n\
                wavelengths_nm = { red = 660, green = 520, blue = 440 }\n";
    let read = Display::from_toml(&format!("{head}{block}"), "plm.toml").unwrap().encoding;
    assert_eq!(read, Display::preset("plm").unwrap().encoding);
}

/// Returns a display with this text as its encoding.
fn with(text: &str, folder: &std::path::Path, [height, width]: [usize; 2], levels: u32) -> Display {
    let head = format!(
        "resolution = [{height}, {width}]\npitch_um = 8.0\nfocal_length_mm = 400.0\nlevels = {levels}\n\
         wavelengths_nm = {{ red = 660, green = 520, blue = 440 }}\n[encoding]\n"
    );
    let file = folder.join("display.toml");
    Display::from_toml(&(head + text), &file.display().to_string()).unwrap_or_else(|e| panic!("{e}"))
}

fn here() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

#[test]
fn a_map_of_ones_own_is_undone() {
    let here = here();
    // Two sub-frames of red have 4 bits each of a word, across the channels, the second backwards. Green has one byte.
    let text = r#"
packing = "map"
two_pi_level = 16
map = [
  { color = "red", sub_frame = 0, video_frame = 0, channel = "rgb", bits = [6, 7, 8, 9] },
  { color = "red", sub_frame = 1, video_frame = 2, channel = "blue", bits = [7, 6, 5, 4] },
  { color = "green", sub_frame = 0, video_frame = 0, channel = "blue", bits = [0, 1, 2, 3] },
  { color = "green", sub_frame = 1, video_frame = 0, channel = "red", bits = [0, 1, 2, 3] },
]"#;
    let display = with(text, here.path(), [3, 9], 16);
    let phases = sets(2, 4 * 27);
    let frames = encode(&display, &ALL[..2], 4, &phases);
    assert_eq!((frames.count(), frames.channels), (6, 3));
    for set in 0..2 {
        for i in 0..27 {
            let byte = |video: usize, channel: usize| frames.frame(3 * set + video)[3 * i + channel];
            let word = u32::from(byte(0, 0)) | u32::from(byte(0, 1)) << 8;
            let back = byte(2, 2) >> 4;
            let back = (back & 1) << 3 | (back & 2) << 1 | (back & 4) >> 1 | (back & 8) >> 3;
            let at = |c: usize, f: usize| phases[c][(2 * set + f) * 27 + i];
            for (level, phase) in [
                ((word >> 6 & 15) as u8, at(0, 0)),
                (back, at(0, 1)),
                (byte(0, 2) & 15, at(1, 0)),
                (byte(0, 0) & 15, at(1, 1)),
            ] {
                assert!(is_nearest(level, phase, even(16), 16), "{phase} became {level}");
            }
            assert_eq!(
                (byte(1, 0), byte(1, 1), byte(1, 2), byte(2, 0)),
                (0, 0, 0, 0),
                "a frame that the map leaves out"
            );
        }
    }
}

#[test]
fn nothing_is_written_of_phases_that_are_none() {
    let display = display("grey8", 3, 4);
    let encoder = Encoder::new(&display, &ALL, 2).unwrap();
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 5e6, -1e30] {
        let mut phases = sets(3, 24);
        phases[1][12 + 4 + 2] = bad;
        let said = PhaseSet::new(&slices(&phases), encoder.hologram_size()).unwrap_err();
        assert!(matches!(said, EncodeError::Phase { color: 1, sub_frame: 1, row: 1, column: 2, .. }), "{said}");
        // Phases that are trusted by mistake give some picture and no panic.
        encoder.encode(&PhaseSet::trusted(&slices(&phases))).unwrap();
    }
    // For phases of another shape no byte is written.
    let mut frames = encoder.frames();
    frames.bytes_mut().fill(7);
    let before = frames.clone();
    let phases = sets(3, 23);
    assert!(encoder.encode_into(&PhaseSet::trusted(&slices(&phases)), &mut frames).is_err());
    assert!(encoder.encode_into(&PhaseSet::trusted(&slices(&sets(2, 24))), &mut frames).is_err());
    assert_eq!(frames, before);
    let mut other = Encoder::new(&display, &ALL, 1).unwrap().frames();
    assert!(encoder.encode_into(&PhaseSet::trusted(&slices(&sets(3, 24))), &mut other).is_err());
}

#[test]
fn what_a_packing_holds_is_said() {
    let refused = |display: &Display, colors: &[Color], n: usize, code: &str, holds: &str| {
        let said = Encoder::new(display, colors, n).unwrap_err();
        assert_eq!(ErrorData::of(&said).code, code, "{said}");
        assert!(said.to_string().contains(holds), "{said}");
    };
    for (preset, colors, n, right) in [
        ("planes24", &ALL[..], 5, "8"),
        ("planes24", &ALL[..1], 8, "24"),
        ("plm", &ALL, 0, "8"),
        ("planes8", &ALL, 3, "8"),
    ] {
        refused(&display(preset, 4, 4), colors, n, "mismatch/sub-frames", right);
    }
    refused(&display("grey8", 4, 4), &[], 3, "mismatch/no-colors", "");
    let here = here();
    for (text, levels, code, holds) in [
        ("packing = \"planes24\"", 16, "display/bits", "levels = 2"),
        ("packing = \"planes8\"\nchannel = \"rgb\"", 2, "mismatch/channel", "channel = \"rgb\""),
        ("cells = [[1, 0]]", 4, "display/cells-and-bits", "planes24"),
        ("packing = \"planes24\"\ncells = [[1, 0]]", 16, "display/lost-bit", "2"),
        ("two_pi_level = { red = 200 }", 256, "display/no-table", "green"),
        ("two_pi_level = 200\nlook_up = { red = \"x.csv\" }", 256, "display/two-tables", "two_pi_level"),
        ("", 300, "display/bits", "256"),
    ] {
        refused(&with(text, here.path(), [4, 4], levels), &ALL, 8, code, holds);
    }
    refused(&Display { levels: 65537, ..display("grey8", 4, 4) }, &ALL, 1, "display/levels", "65536");
    let map = |more: &str, code: &str, holds: &str| {
        let one = |f: u32, bit: u32| {
            format!("{{ color = \"red\", sub_frame = {f}, video_frame = 0, channel = \"red\", bits = [{bit}] }}")
        };
        let text = format!("packing = \"map\"\nmap = [{}, {}]", one(0, 0), more.replace("ONE", &one(1, 0)));
        refused(&with(&text, here.path(), [4, 4], 2), &ALL[..1], 2, code, holds);
    };
    map("ONE", "mismatch/bit-taken", "0");
    let gap = "{ color = \"red\", sub_frame = 2, video_frame = 0, channel = \"red\", bits = [3] }";
    map(gap, "mismatch/map-entries", "1");
    map(&gap.replace("\"red\", bits", "\"grey\", bits"), "mismatch/mixed-frames", "2");
    map(&gap.replace("[3]", "[8]"), "mismatch/map-bits", "8");
    map(&gap.replace("sub_frame = 2", "sub_frame = 4000000000"), "mismatch/too-many", "4096");
}
