//! Tests videos of every layout, and videos that are refused.

use super::*;
use crate::light_field::near::Kind;
use eyebox_base::error::ErrorData;

/// Makes four frames of one color each, which are white, black, red and blue of ITU-R BT.601. The header has these
/// words.
fn video(words: &str, bits: u32, samples: [usize; 2]) -> Vec<u8> {
    let mut bytes = format!("YUV4MPEG2 W5 H3 F30:1 Ip {words}\n").into_bytes();
    let full = words.contains("FULL");
    let colors: [[u32; 3]; 4] = if full {
        [[255, 128, 128], [0, 128, 128], [76, 85, 255], [29, 255, 107]]
    } else {
        [[235, 128, 128], [16, 128, 128], [81, 90, 240], [41, 240, 110]]
    };
    for color in colors {
        bytes.extend(b"FRAME Xany\n");
        for (value, count) in color.iter().zip([15, samples[0] * samples[1], samples[0] * samples[1]]) {
            let value = value << (bits - 8);
            let one = if bits > 8 { (value as u16).to_le_bytes().to_vec() } else { vec![value as u8] };
            bytes.extend(one.repeat(count));
        }
    }
    bytes
}

#[test]
fn frames_of_every_kind_have_their_colours() {
    let here = tempfile::tempdir().unwrap();
    let file = here.path().join("a.y4m");
    for (words, bits, samples) in [
        ("", 8, [2, 3]),
        ("C420jpeg XCOLORRANGE=FULL", 8, [2, 3]),
        ("C420mpeg2", 8, [2, 3]),
        ("C420p10", 10, [2, 3]),
        ("C422", 8, [3, 3]),
        ("C444p12", 12, [3, 5]),
        ("C444", 8, [3, 5]),
    ] {
        std::fs::write(&file, video(words, bits, samples)).unwrap();
        assert_eq!((count(&file).unwrap(), size(&file).unwrap()), (4, [3, 5]), "{words}");
        for (i, wanted) in [[1.0, 1.0, 1.0], [0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]].iter().enumerate() {
            let read = read(&file, i, &[Color::Red, Color::Green, Color::Blue], None).unwrap();
            for (plane, wanted) in read.planes.iter().zip(wanted) {
                assert!(plane.iter().all(|v| (v - wanted).abs() < 0.02), "{words}, frame {i}: {plane:?}");
            }
        }
    }
    std::fs::write(&file, video("Cmono16 XCOLORRANGE=FULL", 16, [0, 0])).unwrap();
    let GrayValues { height, width, kind, values, .. } = stored(&file, 2).unwrap();
    assert_eq!((height, width, kind, values[0]), (3, 5, Kind::Words, 76.0 * 256.0));
}

#[test]
fn what_is_wrong_is_said() {
    let here = tempfile::tempdir().unwrap();
    let file = here.path().join("a.y4m");
    let whole = video("", 8, [2, 3]);
    let says = |bytes: &[u8], frame: usize, what: &str| {
        std::fs::write(&file, bytes).unwrap();
        let error = read(&file, frame, &[Color::Red], None).map(|_| ()).unwrap_err();
        assert_eq!(ErrorData::of(&error).code, what, "{error}");
    };
    says(&whole, 4, "corrupt/no-such-frame");
    says(&whole[..whole.len() - 1], 3, "corrupt/frame-cut-short");
    says(b"RIFF....", 0, "kind");
    says(b"YUV4MPEG2", 0, "corrupt/not-video");
    says(b"YUV4MPEG2\n", 0, "corrupt/not-y4m");
    says(b"YUV4MPEG2 W5 C444\nFRAME\n", 0, "corrupt/video-size");
    says(b"YUV4MPEG2 W5 H3 C411\nFRAME\n", 0, "corrupt/video-chroma");
    says(b"YUV4MPEG2 W5 H3 C4\xff0jpeg\nFRAME\n", 0, "corrupt/video-chroma");
    says(b"YUV4MPEG2 W5 H3 C420p99\nFRAME\n", 0, "corrupt/video-bits");
    says(&String::from_utf8_lossy(&whole).replace("W5", "W4").into_bytes(), 1, "corrupt/frame-start");
    for at in 0..60 {
        let mut bytes = whole.clone();
        bytes[at] ^= 0x15;
        std::fs::write(&file, &bytes).unwrap();
        let _ = read(&file, 1, &[Color::Red], None);
    }
}

/// Makes a frame of red, green, blue and white in BT.709 or BT.601, limited range, after a header.
fn bars(header: &str, matrix: Matrix) -> Vec<u8> {
    let [of_red, of_blue] = if matrix == Matrix::Bt709 { [0.2126, 0.0722] } else { [0.299, 0.114] };
    let mut planes = [const { Vec::new() }; 3];
    for [r, g, b] in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0f32]] {
        let y = of_red * r + (1.0 - of_red - of_blue) * g + of_blue * b;
        let differences = [(b - y) / (2.0 - 2.0 * of_blue), (r - y) / (2.0 - 2.0 * of_red)];
        planes[0].push((16.0 + 219.0 * y).round() as u8);
        (0..2).for_each(|i| planes[i + 1].push((128.0 + 224.0 * differences[i]).round() as u8));
    }
    [format!("YUV4MPEG2 {header}\nFRAME\n").into_bytes(), planes.concat()].concat()
}

/// Each video is read in its own colors, or refused until its matrix is stated and then read in its own colors.
#[test]
fn matrices_are_known_or_refused_until_they_are_stated() {
    use Matrix::{Bt601, Bt709};
    let here = tempfile::tempdir().unwrap();
    let file = here.path().join("a.y4m");
    let colors = [Color::Red, Color::Green, Color::Blue];
    let right = |picture: &Picture| {
        let wanted = [[1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, 1.0]];
        let errors =
            picture.planes.iter().flatten().zip(wanted.iter().flatten()).map(|(a, b): (&f32, &f32)| (a - b).abs());
        errors.fold(0.0, f32::max) < 0.03
    };
    let small = "W4 H1 F25:1 Ip A1:1 C444";
    let cases = [
        (small.to_owned(), Bt601, true),
        (format!("{small} XCOLORMATRIX=BT709"), Bt709, true),
        (format!("{small} XCOLORMATRIX=BT601"), Bt601, true),
        (format!("{small} XCOLORMATRIX=smpte170m"), Bt601, true),
        (format!("{small} XYSCSS=444 XCOLORMATRIX=bt709"), Bt709, true),
        (format!("{small} XYSCSS=444"), Bt709, false),
        (format!("{small} XYSCSS=444"), Bt601, false),
        (format!("{small} XYSCSS=444 XCOLORRANGE=LIMITED"), Bt709, false),
        ("W4 H1 F30000:1001 I? A0:0 C444".to_owned(), Bt601, true),
        ("W4 H1 C444 XYSCSS=444".to_owned(), Bt709, false),
    ];
    for (header, matrix, known) in cases {
        std::fs::write(&file, bars(&header, matrix)).unwrap();
        let found = read(&file, 0, &colors, None);
        assert_eq!(found.is_ok(), known, "{header}");
        match found {
            Ok(picture) => assert!(right(&picture), "{header}"),
            Err(error) => assert!(matches!(error, SceneError::Matrix { .. }), "{header}: {error}"),
        }
        assert!(right(&read(&file, 0, &colors, Some(matrix)).unwrap()), "{header}");
        let other = if matrix == Bt601 { Bt709 } else { Bt601 };
        assert!(!right(&read(&file, 0, &colors, Some(other)).unwrap()), "{header}");
    }
    let high = format!("YUV4MPEG2 W2 H{} C444\nFRAME\n", HIGH);
    std::fs::write(&file, [high.into_bytes(), vec![128; 2 * HIGH * 3]].concat()).unwrap();
    assert!(matches!(read(&file, 0, &colors, None), Err(SceneError::Matrix { .. })));
    read(&file, 0, &colors, Some(Bt709)).unwrap();
}

const HIGH: usize = 720;

#[test]
fn interlaced_films_other_matrices_and_pixels_that_are_not_square_are_refused() {
    let here = tempfile::tempdir().unwrap();
    let file = here.path().join("a.y4m");
    for word in ["It", "Ib", "Im", "A64:45", "A16:11", "A8:9", "A4:3", "XCOLORMATRIX=bt2020nc", "XCOLORMATRIX=ycgco"] {
        std::fs::write(&file, bars(&format!("W4 H1 C444 {word}"), Matrix::Bt601)).unwrap();
        let refused = read(&file, 0, &[Color::Red], None);
        assert!(matches!(refused, Err(SceneError::Corrupt { .. })), "{word}");
        assert!(stored(&file, 0).is_err(), "{word}");
    }
    for word in ["Ip", "I?", "A1:1", "A0:0", "A2:2", "A128:128"] {
        std::fs::write(&file, bars(&format!("W4 H1 C444 {word}"), Matrix::Bt601)).unwrap();
        assert!(read(&file, 0, &[Color::Red], None).is_ok(), "{word}");
    }
}

#[test]
fn names_of_frames_are_read() {
    let of = |name: &str| named(Path::new(name)).map(|(file, frame)| (file.display().to_string(), frame));
    assert_eq!(of("a/b.y4m"), Some(("a/b.y4m".into(), None)));
    assert_eq!(of(&frame(Path::new("a?b.Y4M"), 7)), Some(("a?b.Y4M".into(), Some(7))));
    assert_eq!(of("a.y4m?matrix=bt709"), Some(("a.y4m".into(), None)));
    let third = frame(Path::new("a.y4m?matrix=bt709"), 3);
    assert_eq!((of(&third), Matrix::stated(Path::new(&third))), (Some(("a.y4m".into(), Some(3))), Some(Matrix::Bt709)));
    assert!(of("a.y4m?matrix=x").is_none() && of("a.y4m?matrix").is_none());
    assert!(of("a.png?frame=1").is_none() && of("a.y4m?frame=x").is_none() && of("a.y4m.png").is_none());
}
