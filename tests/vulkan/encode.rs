//! The kernel `encode` on the device against its CPU twin, byte for byte, without messages from the validation layer.

use eyebox::low_level::encode::{Encoder, PhaseSet};
use eyebox::low_level::engine::vulkan::VulkanEncoder;
use eyebox::low_level::gpu::PixelOrder;
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

/// The pictures for swapchains have the size of the video frame, with the fill around the SLM.
#[test]
fn pictures_of_a_part_of_the_video_frame_have_its_fill_around() {
    for (height, width, offset) in [(6, 11, [0, 0]), (7, 12, [2, 8]), (9, 20, [0, 0])] {
        let text = format!(
            "resolution = [{height}, {width}]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = {{ red = 660 }}\n\
             [encoding]\nactive_area = {{ video_size = [9, 20], offset = {offset:?}, fill = 33 }}\n"
        );
        let display = Display::from_toml(&text, "area").unwrap_or_else(|e| panic!("{e}"));
        let encoder = Encoder::new(&display, &ALL[..1], 2).expect("an encoder");
        let set = phases(2 * height * width, 8);
        let want = encoder.encode(&PhaseSet::new(&[&set], [height, width]).expect("phases")).expect("encoded");
        let gpu = gpu();
        let mut device = VulkanEncoder::new(&gpu, encoder.plan()).expect("an encoder");
        device.upload(&[&set]).expect("uploaded");
        device.encode_uploaded().expect("encoded");
        let mut pictures = device.pictures(PixelOrder::Bgra).expect("pictures");
        device.draw(&mut pictures).expect("drawn");
        for i in 0..2 {
            let pixels: Vec<u8> = want.frame(i).iter().flat_map(|level| [*level, *level, *level, 255]).collect();
            assert!(pictures.pixels(&gpu, i).expect("read") == pixels, "{height}x{width}, frame {i}");
        }
    }
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
        ("santec-slm-200", &ALL[1..2], 2),
        ("meadowlark-hdmi-10bit", &ALL[1..2], 2),
        ("ti-plm-0.67-displayport", &ALL[..], 8),
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
    // Levels of more than 8 bits are a power of two, evenly spaced, or in a table.
    let deep = |bits: &[u8], two_pi: f64| {
        format!(
            "packing = \"map\"\ntwo_pi_level = {two_pi}\nmap = [{{ color = \"red\", sub_frame = 0, video_frame = 0, channel \
             = \"rgb\", bits = {bits:?} }}]\n"
        )
    };
    let ten = [20, 21, 22, 23, 13, 14, 15, 5, 6, 7];
    cases.extend([1024.0, 1023.0, 700.0, 1000.5].map(|two_pi| (1024, deep(&ten, two_pi) + grating)));
    let sixteen: Vec<u8> = (0..16).map(|bit| 23 - bit).collect();
    cases.extend([65536.0, 65535.0, 40000.25].map(|two_pi| (65536, deep(&sixteen, two_pi) + grating)));
    // The SLM is a part of its video frame.
    let area = |more: &str| format!("active_area = {{ video_size = [40, 49], offset = [3, 5], fill = 90 }}\n{more}");
    cases.extend([grating, "packing = \"fields\"\nflip_video = \"both\""].map(|more| (256, area(more))));
    cases.push((4, area("packing = \"planes8\"\ncells = [[1], [0]]\nflip_video = \"vertical\"")));
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
