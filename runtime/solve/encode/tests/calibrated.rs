//! Tests levels of 2 pi, tables, corrections and gratings.

use super::*;
use eyebox_base::error::ErrorData;

#[test]
fn the_grey_level_of_two_pi_is_where_it_was_said() {
    let here = here();
    // The value 218 is even, 200.5 is not, and with 300 the SLM does not reach a turn.
    for two_pi in [218.0, 200.5, 300.0, 3.0] {
        let display = with(&format!("two_pi_level = {two_pi}"), here.path(), [40, 50], 256);
        let phases = sets(1, 2000);
        let frames = encode(&display, &ALL[..1], 1, &phases);
        let used = f64::min(f64::ceil(two_pi), 256.0) as u32;
        for (level, phase) in frames.frame(0).iter().zip(&phases[0]) {
            let near = is_nearest(*level, *phase, |l| f64::from(l) / two_pi, used);
            // For uneven levels, the phase is rounded to 1/65536 of a turn, so ties may go either way.
            let tie = |by: f32| is_nearest(*level, phase + by, |l| f64::from(l) / two_pi, used);
            assert!(
                near || (two_pi.fract() != 0.0 || two_pi > 256.0) && (tie(1e-4) || tie(-1e-4)),
                "{two_pi}: {phase}: {level}"
            );
        }
        let notes = Encoder::new(&display, &ALL[..1], 1).unwrap().notes().to_vec();
        assert_eq!(notes.len(), usize::from(two_pi == 300.0), "{notes:?}");
    }
}

#[test]
fn a_table_is_inverted_whether_it_rises_or_not() {
    let here = here();
    let folder = here.path();
    // The phases fall, then rise, past a turn. They are in units of pi.
    let turns = |l: u8| match l {
        0..=9 => 0.9 - 0.05 * f64::from(l),
        _ => 0.37 + 0.04 * f64::from(l),
    };
    let rows: String = (0..40u8).map(|l| format!("{l}, {}\n", 2.0 * turns(l))).collect();
    std::fs::write(folder.join("red.csv"), format!("level,phase_pi\n{rows}")).unwrap();
    let display = with("look_up = { red = \"red.csv\" }", folder, [30, 40], 256);
    let phases = sets(1, 1200);
    let frames = encode(&display, &ALL[..1], 1, &phases);
    // Every level beyond a turn from the smallest phase (0.45) is more than 1/512 turn from the others, or repeats one.
    for (level, phase) in frames.frame(0).iter().zip(&phases[0]) {
        assert!(*level < 40, "{level}");
        let far = |l: u8| {
            let off = f64::from(*phase) / TAU - turns(l);
            (off - off.round()).abs()
        };
        let best = (0..40).map(far).fold(1.0, f64::min);
        assert!(far(*level) <= best + 2.0 / 65536.0, "{phase} became {level}");
    }
    let missing = Encoder::new(&display, &ALL, 1).unwrap_err();
    assert_eq!(ErrorData::of(&missing).code, "display/no-table");
    assert!(missing.to_string().contains("look_up") && missing.to_string().contains("green"), "{missing}");
    std::fs::write(folder.join("red.csv"), "0,0\n1,what\n").unwrap();
    let wrong = Encoder::new(&display, &ALL[..1], 1).unwrap_err();
    let EncodeError::Table { file, line: 2, reason } = &wrong else { panic!("{wrong}") };
    assert!(file.ends_with("red.csv") && reason.code() == "phase" && reason.text().contains("'what'"), "{wrong}");
    std::fs::remove_file(folder.join("red.csv")).unwrap();
    let gone = Encoder::new(&display, &ALL[..1], 1).unwrap_err();
    assert!(matches!(&gone, EncodeError::File(FileError::Read { file, .. }) if file.ends_with("red.csv")), "{gone}");
}

/// Writes one correction in four files, as 8-bit PNG, BMP, 16-bit PNG and float32 radians, and returns its levels.
fn write_corrections(folder: &std::path::Path, height: u32, width: u32) -> Vec<u8> {
    let levels: Vec<u8> = (0..height * width).map(|i| (i * 37 % 256) as u8).collect();
    let grey = image::GrayImage::from_raw(width, height, levels.clone()).unwrap();
    grey.save(folder.join("c8.png")).unwrap();
    image::DynamicImage::ImageLuma8(grey.clone()).into_rgb8().save(folder.join("c8.bmp")).unwrap();
    let deep = levels.iter().map(|l| u16::from(*l) << 8).collect();
    image::ImageBuffer::<image::Luma<u16>, Vec<u16>>::from_raw(width, height, deep)
        .unwrap()
        .save(folder.join("c16.png"))
        .unwrap();
    let radians: Vec<f32> = levels.iter().map(|l| (f64::from(*l) / 256.0 * TAU) as f32).collect();
    crate::files::write_npy(&folder.join("c.npy"), &[height as usize, width as usize], &radians).unwrap();
    levels
}

#[test]
fn corrections_of_every_format_are_added_as_phase() {
    let here = here();
    let folder = here.path();
    let levels = write_corrections(folder, 12, 17);
    let phases = sets(1, 12 * 17);
    for file in ["c8.png", "c8.bmp", "c16.png", "c.npy"] {
        for (sign, two_pi) in [(1i8, 218), (-1, 256)] {
            let text = format!(
                "two_pi_level = {two_pi}\n[[encoding.correction]]\nfile = \"{file}\"\nsign = {sign}\ncolor = \"red\""
            );
            let display = with(&text, folder, [12, 17], 256);
            let frames = encode(&display, &ALL[..1], 1, &phases);
            for (i, level) in frames.frame(0).iter().enumerate() {
                let sum = f64::from(phases[0][i]) + f64::from(sign) * f64::from(levels[i]) / 256.0 * TAU;
                let exact = (sum / TAU).rem_euclid(1.0) * f64::from(two_pi);
                let off = exact - f64::from(*level);
                let off = (off - f64::from(two_pi) * (off / f64::from(two_pi)).round()).abs();
                assert!(off < 0.5 + 1e-3 && i32::from(*level) < two_pi, "{file}: {exact} became {level}");
            }
            // It applies to red alone.
            let plain = with(&format!("two_pi_level = {two_pi}"), folder, [12, 17], 256);
            assert_eq!(encode(&display, &ALL[1..2], 1, &phases), encode(&plain, &ALL[1..2], 1, &phases));
        }
    }
}

#[test]
fn a_correction_added_and_taken_away_changes_nothing() {
    let here = here();
    let folder = here.path();
    write_corrections(folder, 12, 17);
    let phases = sets(3, 8 * 12 * 17);
    for packing in ["grey8", "planes24"] {
        let levels = if packing == "grey8" { 256 } else { 2 };
        let plain = with(&format!("packing = \"{packing}\""), folder, [12, 17], levels);
        for file in ["c8.png", "c8.bmp", "c16.png", "c.npy"] {
            let one = |sign: i32| format!("[[encoding.correction]]\nfile = \"{file}\"\nsign = {sign}\n");
            let text = format!("packing = \"{packing}\"\n{}{}", one(1), one(-1));
            let both = with(&text, folder, [12, 17], levels);
            assert_eq!(encode(&both, &ALL, 8, &phases), encode(&plain, &ALL, 8, &phases), "{file}");
            let added = with(&format!("packing = \"{packing}\"\n{}", one(1)), folder, [12, 17], levels);
            assert_ne!(encode(&added, &ALL, 8, &phases), encode(&plain, &ALL, 8, &phases), "{file}");
        }
    }
}

#[test]
fn corrections_that_cannot_be_are_named() {
    let here = here();
    let folder = here.path();
    write_corrections(folder, 12, 17);
    let mut colored = image::RgbImage::new(17, 12);
    colored.put_pixel(3, 2, image::Rgb([1, 2, 3]));
    colored.save(folder.join("colored.png")).unwrap();
    std::fs::write(folder.join("text.png"), "no picture").unwrap();
    let whole = std::fs::read(folder.join("c8.png")).unwrap();
    std::fs::write(folder.join("short.png"), &whole[..whole.len() - 30]).unwrap();
    for (file, size, code, holds) in [
        ("c8.png", [12, 16], "file/content/correction-size", "12x17"),
        ("c.npy", [11, 17], "file/content/correction-size", "11x17"),
        ("colored.png", [12, 17], "file/content/not-gray", "2 3"),
        ("text.png", [12, 17], "file/kind", ""),
        ("short.png", [12, 17], "file/content/damaged", ""),
        ("none.bmp", [12, 17], "file/read", ""),
    ] {
        let display = with(&format!("[[encoding.correction]]\nfile = \"{file}\"\nsign = 1"), folder, size, 256);
        let error = Encoder::new(&display, &ALL, 1).unwrap_err();
        let said = error.to_string();
        assert_eq!(ErrorData::of(&error).code, code, "{said}");
        assert!(
            holds.split(' ').all(|part| said.contains(part)) && said.contains(file) && !said.contains('\n'),
            "{said}"
        );
    }
}

#[test]
fn a_grating_grows_along_its_direction() {
    let here = here();
    let zeros = [vec![0.0f32; 24 * 40]];
    for (direction, level) in [
        (0.0, &(|_: usize, x: usize| x as f64 * 32.0) as &dyn Fn(usize, usize) -> f64),
        (90.0, &|y, _| y as f64 * 32.0),
        (180.0, &|_, x| x as f64 * -32.0),
        (30.0, &|y, x| (x as f64 * 0.866_025_403_784 + y as f64 * 0.5) * 32.0),
    ] {
        let text = format!("[[encoding.grating]]\nperiod_px = 8\ndirection_deg = {direction}");
        let frames = encode(&with(&text, here.path(), [24, 40], 256), &ALL[..1], 1, &zeros);
        for y in 0..24 {
            for x in 0..40 {
                let off = level(y, x) - f64::from(frames.frame(0)[y * 40 + x]);
                let off = (off - 256.0 * (off / 256.0).round()).abs();
                assert!(off <= 0.5 + 1e-4, "{direction} degrees at {y}, {x}: {off}");
            }
        }
    }
}
