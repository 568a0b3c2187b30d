//! Tests levels of more than 8 bits, which take bits of several channels of a video frame.

use super::*;
use crate::optics::PRESETS;

/// Returns the phases of all levels of a display of one color, and its encoder.
fn all_levels(preset: &str, two_pi: f64) -> (Display, Vec<f32>) {
    let display = display(preset, 32, 32);
    assert_eq!(display.levels, 1024, "{preset}");
    (display, (0..1024).map(|n| (f64::from(n) / two_pi * TAU) as f32).collect())
}

/// The preset, the levels of a full turn, and the channels of a level.
type Link<'a> = (&'a str, f64, &'a dyn Fn(u32) -> [u32; 3]);

/// Each level is compared with the bytes that the description of the link states.
#[test]
fn ten_bits_are_where_the_link_has_them() {
    let meadowlark = |n: u32| [n >> 2, 0, n & 3];
    // R7 to R5, G7 to G5, B7 to B4, the highest bit first.
    let santec = |n: u32| [n >> 7 << 5, (n >> 4 & 7) << 5, (n & 15) << 4];
    let links: [Link<'_>; 2] = [("meadowlark-hdmi-10bit", 1024.0, &meadowlark), ("santec-slm-200", 1023.0, &santec)];
    for (preset, two_pi, link) in links {
        let (display, phases) = all_levels(preset, two_pi);
        let frames = encode(&display, &[Color::Green], 1, std::slice::from_ref(&phases));
        assert_eq!((frames.count(), frames.channels), (1, 3));
        for (n, pixel) in (0..1024).zip(frames.frame(0).chunks(3)) {
            // The phase of the level of 2 pi is the phase of level 0.
            let level = if f64::from(n) == two_pi { 0 } else { n };
            assert_eq!(pixel, link(level).map(|b| b as u8), "{preset}: level {n}");
        }
        let decoder = Decoder::new(&display, &[Color::Green], 1, AsShown::default()).unwrap();
        let decoded = decoder.decode(&frames, |i| i.to_string()).unwrap().remove(0);
        for (phase, decoded) in phases.iter().zip(decoded) {
            let off = f64::from(phase - decoded) / TAU;
            assert!((off - off.round()).abs() < 1e-6, "{preset}: {phase} became {decoded}");
        }
    }
}

/// Returns a display with a map of one entry with these bits of the pixel.
fn mapped(bits: &[u8], levels: u32, more: &str) -> Display {
    let text = format!(
        "packing = \"map\"\nmap = [{{ color = \"green\", sub_frame = 0, video_frame = 0, channel = \"rgb\", bits = \
         {bits:?} }}]\n{more}"
    );
    with(&text, std::path::Path::new(""), [256, 256], levels)
}

#[test]
fn sixteen_bits_hold_65536_levels_in_any_order() {
    let bits = [23, 0, 9, 17, 5, 16, 2, 10, 8, 3, 7, 20, 12, 1, 22, 15];
    // Level 65535 is the last of 65536, and 2 pi of 65535.
    for (two_pi, count) in [(65536u32, 65536), (65535, 65535)] {
        let display = mapped(&bits, 65536, &format!("two_pi_level = {two_pi}"));
        let phase = |n: u32| (f64::from(n % count) / f64::from(two_pi) * TAU) as f32;
        let phases: Vec<f32> = (0..65536).map(phase).collect();
        let frames = encode(&display, &[Color::Green], 1, std::slice::from_ref(&phases));
        for (n, pixel) in (0..65536u32).zip(frames.frame(0).chunks(3)) {
            let word = u32::from(pixel[0]) | u32::from(pixel[1]) << 8 | u32::from(pixel[2]) << 16;
            let level = bits.iter().enumerate().fold(0, |level, (i, bit)| level | (word >> bit & 1) << i);
            let others = bits.iter().fold(word, |word, bit| word & !(1 << bit));
            assert_eq!((level, others), (n % count, 0));
        }
        let decoder = Decoder::new(&display, &[Color::Green], 1, AsShown::default()).unwrap();
        let decoded = decoder.decode(&frames, |i| i.to_string()).unwrap();
        assert!(encode(&display, &[Color::Green], 1, &decoded) == frames);
    }
}

#[test]
fn uneven_levels_of_many_bits_are_the_nearest_of_their_table() {
    let here = here();
    let turns = |n: u32| (f64::from(n) / 1024.0).powf(1.2);
    let rows: String = (0..1024).map(|n| format!("{n}\t{}\n", turns(n))).collect();
    std::fs::write(here.path().join("t.csv"), format!("level\tphase_turns\n{rows}")).unwrap();
    let file = here.path().join("t.csv");
    let display = mapped(&[16, 17, 0, 1, 2, 3, 4, 5, 6, 7], 1024, &format!("look_up = {{ green = {file:?} }}"));
    let phases = sets(1, 65536);
    let frames = encode(&display, &[Color::Green], 1, &phases);
    for (pixel, phase) in frames.frame(0).chunks(3).zip(&phases[0]) {
        let level = u32::from(pixel[0]) << 2 | u32::from(pixel[2]);
        let far = |n: u32| {
            let off = f64::from(*phase) / TAU - turns(n);
            (off - off.round()).abs()
        };
        let best = (0..1024).map(far).fold(1.0, f64::min);
        assert!(far(level) <= best + 2.0 / 65536.0, "{phase} became {level}");
    }
}

#[test]
fn maps_of_too_many_or_repeated_bits_are_refused() {
    let refused = |bits: &[u8], levels: u32| {
        let error = Encoder::new(&mapped(bits, levels, ""), &[Color::Green], 1).unwrap_err();
        ErrorData::of(&error).code
    };
    let bits: Vec<u8> = (0..17).collect();
    assert_eq!(refused(&bits, 65536), "mismatch/map-bits");
    assert_eq!(refused(&[0, 1, 2, 3, 4, 5, 6, 7, 16, 16], 1024), "mismatch/bit-taken");
    assert_eq!(refused(&[0, 1, 2, 3, 4, 5, 6, 7, 16], 1024), "display/bits");
    // A gray frame of 8 bits does not hold 1024 levels.
    let error = Encoder::new(&Display { levels: 1024, ..display("grey8", 2, 2) }, &ALL[..1], 1).unwrap_err();
    assert_eq!(ErrorData::of(&error).code, "display/bits");
}

/// The error of the light is (pi / N)^2 / 3 for N even levels, so that two more bits gain 12 dB.
#[test]
fn two_more_bits_gain_12_decibels() {
    let error = |preset: &str, bits: i32| {
        let display = display(preset, 64, 64);
        let phases = noise(4096, 5).iter().map(|p| p % 1e4).collect::<Vec<f32>>();
        let colors = [Color::Green];
        let frames = encode(&display, &colors, 1, std::slice::from_ref(&phases));
        let decoder = Decoder::new(&display, &colors, 1, AsShown::default()).unwrap();
        let decoded = decoder.decode(&frames, |i| i.to_string()).unwrap().remove(0);
        // Every fifth phase is at an edge, and not random.
        let pairs = phases.iter().zip(&decoded).enumerate().filter(|(i, _)| i % 5 != 0);
        let powers = pairs.map(|(_, (p, d))| 2.0 - 2.0 * (f64::from(*p) - f64::from(*d)).cos());
        let mean = powers.clone().sum::<f64>() / powers.count() as f64;
        let expected = (std::f64::consts::PI / 2f64.powi(bits)).powi(2) / 3.0;
        assert!((mean / expected - 1.0).abs() < 0.1, "{preset}: {mean}, not {expected}");
        10.0 * mean.log10()
    };
    let gain = error("grey8", 8) - error("meadowlark-hdmi-10bit", 10);
    assert!((gain - 12.04).abs() < 0.5, "{gain} dB");
    assert!((error("grey8", 8) - error("santec-slm-200", 10) - 12.04).abs() < 0.5);
}

/// Each level of each preset is encoded, decoded, and encoded as the same level.
#[test]
fn every_level_of_every_preset_returns() {
    for name in PRESETS {
        let preset = Display::preset(name).unwrap();
        let colors = [preset.wavelengths[0].color];
        let display = display(name, 4, preset.levels.div_ceil(4) as usize);
        let sub_frames = [1, 8, 24].into_iter().find(|n| Packed::new(&display.encoding, &colors, *n).is_ok());
        let sub_frames = sub_frames.expect("a set");
        let turns = |n: u32| match (&display.encoding.phases_turns[..], &display.encoding.two_pi_level) {
            ([], Some(crate::optics::TwoPi::One(two_pi))) => f64::from(n) / two_pi,
            ([], _) => f64::from(n) / f64::from(display.levels),
            (listed, _) => listed[n as usize],
        };
        let pixels = display.height * display.width;
        let phases: Vec<f32> =
            (0..sub_frames * pixels).map(|i| (turns(i as u32 % display.levels) * TAU) as f32).collect();
        let frames = encode(&display, &colors, sub_frames, std::slice::from_ref(&phases));
        let decoder = Decoder::new(&display, &colors, sub_frames, AsShown::default()).unwrap();
        let decoded = decoder.decode(&frames, |i| i.to_string()).unwrap();
        for (phase, decoded) in phases.iter().zip(&decoded[0]) {
            let off = f64::from(phase - decoded) / TAU;
            assert!((off - off.round()).abs() < 1e-5, "{name}: {phase} became {decoded}");
        }
        assert!(encode(&display, &colors, sub_frames, &decoded) == frames, "{name}");
    }
}

/// The rates of the controller's links, and the order in which it numbers planes.
#[test]
fn mirrors_of_ti_have_the_rate_of_their_link_and_begin_with_green() {
    for (preset, hz) in [("ti-plm-0.67-hdmi", 30.0), ("ti-plm-0.67-displayport", 60.0)] {
        let display = Display { levels: 16, ..display(preset, 2, 3) };
        assert_eq!(display.rate_hz, Some(hz));
        assert!((display.sub_frame_us() - 1e6 / hz / 24.0).abs() < 1e-9);
        // Only sub-frame n is not level 0, whose code is 3. Level 15 has code 12, so that all four cells change.
        for n in 0..24 {
            let phases: Vec<f32> = (0..24 * 6).map(|i| if i / 6 == n { (0.9375 * TAU) as f32 } else { 0.0 }).collect();
            let frames = encode(&display, &[Color::Red], 24, &[phases]);
            let still = encode(&display, &[Color::Red], 24, &[vec![0.0; 24 * 6]]);
            let changed = frames.frame(0).chunks(3).zip(still.frame(0).chunks(3));
            let wanted: [u8; 3] = std::array::from_fn(|c| if c == [1, 0, 2][n / 8] { 1 << (n % 8) } else { 0 });
            assert!(
                changed.into_iter().all(|(a, b)| [a[0] ^ b[0], a[1] ^ b[1], a[2] ^ b[2]] == wanted),
                "{preset} {n}"
            );
        }
    }
}
