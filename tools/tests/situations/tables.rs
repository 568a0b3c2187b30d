//! Situations with look-up tables of SLMs.

use crate::common::done;
use crate::frame::{Case, Chapter, Outcome, case, change, mended};
use crate::judge::Judge;
use crate::write::file;
use eyebox::low_level::files::write_npy;
use std::f64::consts::{PI, TAU};
use std::path::Path;
use std::sync::OnceLock;

const ENCODE: &str = "encode p.npy --display bench.toml --color green --engine cpu -o frames";
const DISPLAY: &str = "name = \"bench\"\nresolution = [24, 32]\npitch_um = 8.0\nfocal_length_mm = 200.0\n\
                       wavelengths_nm = { green = 520 }\n\n[encoding]\nlook_up = { green = \"NAME\" }\n";

/// Returns each fifteenth level and its phase [radians]. The phases cover slightly more than a turn and are not linear.
fn rows() -> impl Iterator<Item = (u32, f64)> {
    (0..=17).map(|i| (15 * i, 2.1 * PI * (f64::from(i) / 17.0).powf(1.3)))
}

/// Returns a table with this first line and the rows that `row` writes.
fn table(head: &str, row: impl Fn(u32, f64) -> String) -> String {
    let lines = rows().map(|(level, phase)| row(level, phase));
    [head.to_owned()].into_iter().filter(|head| !head.is_empty()).chain(lines).map(|line| line + "\n").collect()
}

fn plain() -> String {
    table("level,phase_rad", |level, phase| format!("{level},{phase:.6}"))
}

/// Writes phases, a display, and its table in a file of this name.
fn bench(at: &Path, name: &str, table: &[u8]) {
    let phases: Vec<f32> = (0..24 * 32).map(|i| (i as f64 * 0.37 % TAU - PI) as f32).collect();
    write_npy(&at.join("p.npy"), &[1, 24, 32], &phases).expect("an array");
    file(&at.join("bench.toml"), DISPLAY.replace("NAME", name));
    file(&at.join(name), table);
}

const SAME: Judge = Judge::By(same);

/// Checks that the levels of the SLM equal the levels with the plain table.
fn same(outcome: &Outcome) -> Result<(), String> {
    static RIGHT: OnceLock<Vec<u8>> = OnceLock::new();
    let levels =
        |folder: &Path| image::open(folder.join("frames/frame-00000.png")).map(|frame| frame.into_luma8().into_raw());
    let right = RIGHT.get_or_init(|| {
        let temp = crate::common::folder();
        bench(temp.path(), "t.csv", plain().as_bytes());
        done(temp.path(), &ENCODE.split(' ').collect::<Vec<_>>());
        levels(temp.path()).expect("a frame")
    });
    let found = levels(outcome.folder).map_err(|e| e.to_string())?;
    let other = found.iter().zip(right).filter(|(a, b)| a != b).count();
    if other == 0 && found.len() == right.len() { Ok(()) } else { Err(format!("{other} levels differ")) }
}

fn of(have: &str, name: &'static str, table: impl Fn() -> Vec<u8> + Send + Sync + 'static) -> Case {
    case(have, ENCODE, move |at| bench(at, name, &table()))
}

fn csv(have: &str, table: impl Fn() -> String + Send + Sync + 'static) -> Case {
    of(have, "t.csv", move || table().into_bytes())
}

/// Writes the plain table and replaces a wrong one.
fn corrected(at: &Path) {
    file(&at.join("t.csv"), plain());
}

pub fn chapter() -> Chapter {
    let situations =
        vec![
            csv("A table of Windows.", || plain().replace('\n', "\r\n")).right(SAME),
            csv("A table of an old Mac, with CR alone.", || plain().replace('\n', "\r")).right(SAME),
            csv("A table with a byte order mark, as Excel saves it.", || format!("\u{feff}{}", plain())).right(SAME),
            of("A table in UTF-16, as LabVIEW on Windows saves it.", "t.csv", || {
                [0xfeff].into_iter().chain(plain().encode_utf16()).flat_map(u16::to_le_bytes).collect()
            })
            .right(SAME),
            csv("A table with tabs.", || plain().replace(',', "\t")).right(SAME),
            csv("A German table has semicolons, decimal commas, and phases in pi.", || {
                table("Gray level;Phase [pi]", |level, phase| format!("{level};{:.7}", phase / PI).replace('.', ","))
            })
            .right(SAME),
            csv("Phases are in degrees.", || {
                table("level,phase_deg", |level, phase| format!("{level},{:.5}", phase.to_degrees()))
            })
            .right(SAME),
            csv("Phases are in turns.", || {
                table("level,phase_turns", |level, phase| format!("{level},{:.7}", phase / TAU))
            })
            .right(SAME),
            csv("The phase is the first column.", || {
                table("phase_rad,level", |level, phase| format!("{phase:.6},{level}"))
            })
            .right(SAME),
            csv("A third column has the intensity.", || {
                table("level,phase_rad,intensity", |level, phase| format!("{level},{phase:.6},0.9"))
            })
            .right(SAME),
            csv("Comments are above the table.", || format!("# bench 3, May 4\n{}", plain())).right(SAME),
            csv("A table of radians without a first line.", || table("", |level, phase| format!("{level},{phase:.6}")))
                .right(SAME),
            csv("A table from the highest level down.", || {
                let plain = plain();
                let (head, rest) = plain.split_once('\n').expect("lines");
                format!("{head}\n{}\n", rest.lines().rev().collect::<Vec<_>>().join("\n"))
            })
            .right(SAME),
            csv("A level is above the SLM's levels.", || plain().replace("255,", "300,")).refused(
                "encode/table/level '300'",
                change("255", corrected),
                SAME,
            ),
            csv("A level occurs twice.", || format!("{}255,6.6\n", plain())).refused(
                "encode/table/level-twice 255",
                change("20", corrected),
                SAME,
            ),
            csv("A table is empty.", String::new).refused(
                "encode/table/levels-count",
                change("level,phase_rad", corrected),
                SAME,
            ),
            csv("A table was cut off after its first row.", || "level,phase_rad\n0,0.0\n".into()).refused(
                "encode/table/levels-count",
                mended("at least two are wanted", corrected),
                SAME,
            ),
            csv("A table has voltages instead of phases.", || "level,voltage\n0,1.0\n255,3.0\n".into()).refused(
                "encode/table/columns 'level,voltage'",
                change("level,phase_rad", corrected),
                SAME,
            ),
            csv("A table of turns does not name its unit.", || {
                table("level,phase", |level, phase| format!("{level},{:.6}", phase / TAU))
            })
            .refused("encode/table/no-unit", change("level,phase_rad", corrected), SAME),
            csv("A level is a word.", || plain().replace("45,", "forty,")).refused(
                "encode/table/level 'forty'",
                change("255", corrected),
                SAME,
            ),
            csv("All levels have the same phase.", || table("level,phase_rad", |level, _| format!("{level},1.0")))
                .refused("encode/table/span 0.0000", change("1/6", corrected), SAME),
            of("Meadowlark's file of driver values.", "t.lut", || {
                (0..256).map(|i| format!("{i} {}\n", 16 * i)).collect::<String>().into_bytes()
            })
            .refused(
                "encode/table/driver-values",
                change("'level,phase_rad'", |at| {
                    file(&at.join("t.lut"), plain());
                }),
                SAME,
            ),
            of("An Excel workbook.", "t.xls", || [b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1".to_vec(), vec![0; 99]].concat())
                .refused(
                    "file/kind",
                    change("(CSV)", |at| {
                        corrected(at);
                        file(&at.join("bench.toml"), DISPLAY.replace("NAME", "t.csv"));
                    }),
                    SAME,
                ),
        ];
    Chapter {
        title: "Look-up tables of SLMs",
        about: "The display's file names a table of the phase at each level.",
        situations,
    }
}
