//! Situations with files of displays.

use crate::common::done;
use crate::frame::{Case, Chapter, Outcome, Situation, case, change, mended};
use crate::judge::Judge;
use crate::write::file;
use eyebox::low_level::files::read_npy;
use std::path::Path;
use std::sync::OnceLock;

const RIGHT: &str = "name = \"bench\"\nresolution = [24, 32]\npitch_um = 8.0\nfocal_length_mm = 200.0\n\
                     wavelengths_nm = { red = 640, green = 520, blue = 450 }\n";
const SEEN: &str =
    "render builtin:still-life --display bench.toml --color green --views 3 --pupil=1,0,1,0.2 --engine cpu -o p.npy";

/// Checks that the picture equals the picture of the right file.
const SAME: Judge = Judge::By(same);

fn same(outcome: &Outcome) -> Result<(), String> {
    static RIGHTLY: OnceLock<Vec<f32>> = OnceLock::new();
    let right = RIGHTLY.get_or_init(|| {
        let temp = crate::common::folder();
        bench(temp.path());
        done(temp.path(), &SEEN.split(' ').collect::<Vec<_>>());
        read_npy(&temp.path().join("p.npy")).expect("a picture").values
    });
    let found = read_npy(&outcome.folder.join("p.npy")).map_err(|e| e.to_string())?.values;
    if &found == right { Ok(()) } else { Err("the picture differs".into()) }
}

/// Writes the right file and replaces a wrong one.
fn bench(at: &Path) {
    file(&at.join("bench.toml"), RIGHT);
}

/// A situation with a display file that has `to` instead of `from`.
fn with(have: &str, from: &'static str, to: &'static str) -> Case {
    case(have, SEEN, move |at| {
        assert!(RIGHT.contains(from));
        file(&at.join("bench.toml"), RIGHT.replace(from, to));
    })
}

fn bytes(have: &str, bytes: impl Fn() -> Vec<u8> + Send + Sync + 'static) -> Case {
    case(have, SEEN, move |at| file(&at.join("bench.toml"), bytes()))
}

pub fn chapter() -> Chapter {
    let situations = vec![
        bytes("A display file of Windows, with CR and LF.", || RIGHT.replace('\n', "\r\n").into()).right(SAME),
        bytes("A display file of an old Mac, with CR alone.", || RIGHT.replace('\n', "\r").into()).right(SAME),
        bytes("A display file that Notepad saved with a byte order mark.", || format!("\u{feff}{RIGHT}").into())
            .right(SAME),
        bytes("A display file in UTF-16.", || {
            [0xfeff].into_iter().chain(RIGHT.encode_utf16()).flat_map(u16::to_le_bytes).collect()
        })
        .right(SAME),
        with("The pitch has a decimal comma.", "pitch_um = 8.0", "pitch_um = 8,0").refused(
            "optics/display-file/decimal-comma 8,0",
            change("8.0", bench),
            SAME,
        ),
        with("A wavelength has a decimal comma.", "green = 520,", "green = 520,0,").refused(
            "optics/display-file/decimal-comma 520,0",
            change("520.0", bench),
            SAME,
        ),
        with("The pitch is in meters.", "pitch_um = 8.0", "pitch_um = 8e-6").refused(
            "optics/display-file/out-of-range 8e-6",
            mended("probably 8 is meant", bench),
            SAME,
        ),
        with("The focal length is in meters.", "200.0", "0.2").refused(
            "arguments/unusual 0.2",
            change("200", bench),
            SAME,
        ),
        with("A wavelength is in micrometers.", "520", "0.52").refused(
            "optics/display-file/out-of-range",
            change("520", bench),
            SAME,
        ),
        with("A wavelength is in meters.", "520", "5.2e-7").refused(
            "optics/display-file/out-of-range",
            change("520", bench),
            SAME,
        ),
        with("The pitch has a key of another unit.", "pitch_um = 8.0", "pitch_mm = 0.008").refused(
            "optics/display-file/toml `pitch_mm`",
            change("`pitch_um`", bench),
            SAME,
        ),
        with("A key is misspelled.", "focal_length_mm", "focal_lenght_mm").refused(
            "optics/display-file/toml `focal_lenght_mm`",
            change("`focal_length_mm`", bench),
            SAME,
        ),
        with("The focal length is missing.", "focal_length_mm = 200.0\n", "").refused(
            "optics/display-file/toml",
            change("`focal_length_mm`", bench),
            SAME,
        ),
    ];
    Chapter {
        title: "Files of displays",
        about: "The file `bench.toml` describes an SLM of 24 x 32 pixels.",
        situations: situations.into_iter().chain(keys_and_values()).collect(),
    }
}

/// Returns situations with keys and values that no display file has.
fn keys_and_values() -> Vec<Situation> {
    vec![
        with("A key of another program's file remains.", "name =", "vendor = \"x\"\nname =").refused(
            "optics/display-file/toml `vendor`",
            mended("line 1", bench),
            SAME,
        ),
        with("A number is in quotes.", "8.0", "\"8.0\"").refused(
            "optics/display-file/toml \"8.0\"",
            mended("line 3", bench),
            SAME,
        ),
        with("The resolution is a text.", "[24, 32]", "\"24x32\"").refused(
            "optics/display-file/toml \"24x32\"",
            mended("an array of length 2", bench),
            SAME,
        ),
        with("A color has an unknown name.", "green = 520", "amber = 520").refused(
            "optics/display-file/toml `amber`",
            change("`green`", bench),
            SAME,
        ),
        with("A color has two wavelengths.", "green = 520", "green = [520, 532]").refused(
            "optics/display-file/toml",
            mended("line 5", bench),
            SAME,
        ),
        with(
            "The wavelengths of red and blue are exchanged.",
            "red = 640, green = 520, blue = 450",
            "red = 450, green = 520, blue = 640",
        )
        .refused("arguments/unusual", mended("red is the longer wavelength", bench), SAME),
        with("A key occurs twice.", "name =", "pitch_um = 9.0\nname =").refused(
            "optics/display-file/toml",
            mended("line 4", bench),
            SAME,
        ),
        with("The pitch is negative.", "8.0", "-8.0").refused(
            "optics/display-file/not-positive -8",
            mended("a positive, finite number", bench),
            SAME,
        ),
    ]
}
