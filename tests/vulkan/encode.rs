//! The kernel `encode` on the device against its CPU twin, byte for byte, without messages from the validation layer.

use eyebox::low_level::encode::{Encoder, PhaseSet};
use eyebox::low_level::engine::vulkan::VulkanEncoder;
use eyebox::low_level::optics::{Color, Display};
use eyebox_tests::both::{Noise, gpu};
use std::f32::consts::TAU;
use std::sync::PoisonError;

const ALL: [Color; 3] = [Color::Red, Color::Green, Color::Blue];
const EDGES: [f32; 10] =
    [0.0, -0.0, TAU, TAU.next_down(), -TAU.next_up(), -1e-8, 1e6, -1e6, 4_194_303.8, f32::MIN_POSITIVE / 4.0];

fn phases(count: usize, seed: u64) -> Vec<f32> {
    let mut noise = Noise::new(seed);
    (0..count)
        .map(|i| match i % 6 {
            0 => EDGES[(noise.draw() * 10.0) as usize % 10],
            1 => (noise.draw() - 0.5) * 8e6,
            _ => (noise.draw() - 0.5) * 40.0,
        })
        .collect()
}

/// Encodes one set on the device and with the twin. Every byte must agree.
fn check(display: &Display, colors: &[Color], sub_frames: usize) {
    let encoder = Encoder::new(display, colors, sub_frames).unwrap_or_else(|e| panic!("{e}"));
    let [h, w] = encoder.hologram_size();
    let sets: Vec<Vec<f32>> = (0..colors.len()).map(|c| phases(sub_frames * h * w, 3 + c as u64)).collect();
    let slices: Vec<&[f32]> = sets.iter().map(|p| &p[..]).collect();
    let set = PhaseSet::new(&slices, [h, w]).expect("phases");
    let want = encoder.encode(&set).expect("the twin encodes");
    let mut device = VulkanEncoder::new(&gpu(), encoder.plan()).unwrap_or_else(|e| panic!("{e}"));
    let mut got = encoder.frames();
    device.encode(set.colors(), got.bytes_mut()).unwrap_or_else(|e| panic!("{e}"));
    let differ = got.bytes().iter().zip(want.bytes()).filter(|(a, b)| a != b).count();
    assert_eq!(differ, 0, "{} {h}x{w}: {differ} of {} bytes differ", display.name, want.bytes().len());
    let messages = device.gpu().messages();
    drop(device);
    let heard = messages.lock().unwrap_or_else(PoisonError::into_inner);
    assert!(heard.is_empty(), "messages of the validation layer:\n{}", heard.join("\n"));
}

#[test]
fn every_preset() {
    for (preset, colors, sub_frames) in [
        ("grey8", &ALL[..], 2),
        ("fields", &ALL[..], 2),
        ("planes8", &ALL[1..], 8),
        ("planes24", &ALL[..], 8),
        ("planes24", &ALL[..1], 24),
        ("plm", &ALL[..], 8),
        ("small", &ALL[..1], 1),
    ] {
        for (height, width) in [(1, 1), (5, 7), (12, 64), (33, 258)] {
            let display = Display { height, width, ..Display::preset(preset).expect("a preset") };
            check(&display, colors, sub_frames);
        }
    }
}

#[test]
fn the_paper_s_size() {
    check(&Display::preset("planes24").expect("a preset"), &ALL, 8);
}

#[test]
fn every_kind_of_levels_turns_and_cells() {
    let map = r#"
packing = "map"
two_pi_level = 16
map = [
  { color = "red", sub_frame = 0, video_frame = 0, channel = "rgb", bits = [6, 7, 8, 9] },
  { color = "red", sub_frame = 1, video_frame = 2, channel = "blue", bits = [7, 6, 5, 4] },
]"#;
    let grating = "[[encoding.grating]]\nperiod_px = 7.3\ndirection_deg = 33";
    let turns = ["flip = \"both\"\nrotation_deg = 90", "rotation_deg = 180", "rotation_deg = 270\nflip = \"vertical\""];
    let mut cases = vec![
        (256, format!("two_pi_level = 218\n{grating}")),
        (256, format!("two_pi_level = 200.5\n{grating}")),
        (16, map.to_owned()),
        (2, "packing = \"planes8\"\nchannel = \"green\"\nflip_video = \"both\"".to_owned()),
        (8, "packing = \"planes8\"\ncells = [[2, 0, 1]]\nflip_video = \"both\"".to_owned()),
        (16, "packing = \"planes24\"\ncells = [[2], [0], [1], [3]]\nflip_video = \"vertical\"".to_owned()),
    ];
    // Four neighboring pixels are also neighbors in the hologram.
    cases.push((256, format!("flip = \"vertical\"\noffset_px = [3, -8]\n{grating}")));
    cases.extend(turns.map(|turn| (256, format!("{turn}\noffset_px = [3, -5]\n{grating}"))));
    for (levels, encoding) in cases {
        for (height, width) in [(6, 11), (17, 24)] {
            let text = format!(
                "resolution = [{height}, {width}]\npitch_um = 8.0\nfocal_length_mm = 400.0\nlevels = {levels}\n\
                 wavelengths_nm = {{ red = 660 }}\n[encoding]\n{encoding}\n"
            );
            let display = Display::from_toml(&text, &encoding).unwrap_or_else(|e| panic!("{e}"));
            check(&display, &ALL[..1], if encoding.contains("planes24") { 24 } else { 8 });
        }
    }
}
