//! A light source with a size or a linewidth, from the display file to the picture.

use crate::common::{Printed, attributes, document, done, eyebox, figures_of, folder, json, refused, text};
use eyebox::low_level::files::read_npy;

const BENCH: &str =
    "resolution = [64, 64]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n";
const SQUARE: &str = "[source.green]\nimage_mm = 2\nshape = \"square\"\n";

/// A hologram stores the light source for which it was solved, with as few modes as the scene required. Its views use
/// this source.
#[test]
fn a_hologram_keeps_its_light() {
    let dir = folder();
    let at = dir.path();
    std::fs::write(at.join("laser.toml"), format!("{BENCH}[source.all]\nkind = \"laser\"\n")).unwrap();
    std::fs::write(at.join("plain.toml"), BENCH).unwrap();
    std::fs::write(at.join("wide.toml"), format!("{BENCH}{SQUARE}")).unwrap();
    let settings = ["--steps", "8", "--frames", "1", "--pupil-diameter", "3.5..4.5", "--engine", "cpu"];
    let solve = |display: &str, out: &str| {
        let first = ["solve", "builtin:still-life", "--display", display, "-o", out];
        done(at, &[&first[..], &settings].concat());
    };
    let view = |hologram: &str, out: &str, more: &[&str]| {
        let pupil = ["--pupil", "1,-1,4,0", "--engine", "cpu", "-o", out];
        let answer = eyebox(at, &[&["render", hologram][..], &pupil, more].concat());
        assert!(answer.status.success(), "{}", text(&answer.stderr));
        (read_npy(&at.join(out)).unwrap().values, text(&answer.stderr))
    };
    let score = |hologram: &str| {
        let line = [
            "eval",
            "score",
            hologram,
            "builtin:still-life",
            "--json",
            "--jod",
            "none",
            "--engine",
            "cpu",
            "--pupil-diameter",
            "4..4",
        ];
        let said = done(at, &line);
        serde_json::from_str::<serde_json::Value>(&said).unwrap()["psnr_db"]["mean"].as_f64().unwrap()
    };
    solve("plain.toml", "plain.zarr");
    solve("laser.toml", "laser.zarr");
    solve("wide.toml", "wide.zarr");
    // A laser needs no modes, so that the bytes are the same.
    assert!(view("laser.zarr", "laser.npy", &[]).0 == view("plain.zarr", "plain.npy", &[]).0);
    let (lit, said) = view("wide.zarr", "wide.npy", &[]);
    assert!(said.has("9 --ideal"), "{said}");
    let (point, said) = view("wide.zarr", "point.npy", &["--ideal"]);
    assert!(lit != point && !said.has("9") && !said.has("--ideal"), "{said}");
    assert!(score("wide.zarr") > score("plain.zarr") + 0.5);
    let refine = ["refine", "wide.zarr", "builtin:still-life", "--pupil=1,-1,4,0", "--steps", "2", "--engine", "cpu"];
    done(at, &[&refine[..], &["-o", "refined.zarr"]].concat());
    assert!(view("refined.zarr", "refined.npy", &[]).1.has("9 --ideal"));
    let source = |hologram: &str| attributes(&at.join(hologram))["settings"]["source"].clone();
    assert!(
        source("wide.zarr").is_object() && source("refined.zarr") == source("wide.zarr"),
        "{}",
        source("wide.zarr")
    );
    // The plan has the number of modes and the effect of one more.
    let plan = [&["solve", "builtin:still-life", "--dry-run", "--display", "wide.toml"][..], &settings].concat();
    let planned = json(at, &[&plan[..], &["--json"]].concat());
    let choice = planned["choices"].as_array().unwrap().iter().find(|choice| choice["what"] == "source").unwrap();
    assert!(choice["value"].as_str().unwrap().has("green 9"), "{choice}");
    // The reason has the samples of the source's size and line, and the narrowest pupil of 3.5 mm. It also has the
    // contrast through this pupil, the contrast of the source itself, and the contrast with one more sample.
    let why = choice["why"].as_str().unwrap();
    assert!(why.number("mm") == 3.5 && why.numbers().len() >= 6, "{choice}");
    assert_eq!(done(at, &plan).lines_with("green 9 3.5 mm"), 1);
}

#[test]
fn a_bad_source_is_refused_in_a_line() {
    let dir = folder();
    let at = dir.path();
    let solve = ["solve", "builtin:still-life", "--display", "bad.toml", "--engine", "cpu", "-o", "out.zarr"];
    for (source, says) in [
        ("[source.green]\nmodes = [{ weight = 0 }]\n", "source-without-light"),
        ("[source.green]\nmodes = [{ weight = -1 }]\n", "range -1"),
        ("[source.green]\nmodes = [{ weight = 1, wavelength_nm = 600 }]\n", "line-width 600.0"),
        ("[source.green]\nmodes = [{ weight = 1, angle_mrad = [40, 0] }]\n", "source-angle 40.00"),
    ] {
        std::fs::write(at.join("bad.toml"), format!("{BENCH}{source}")).unwrap();
        refused(at, &solve, "out.zarr", &format!("optics/display-file/{says} bad.toml [source.green]"));
    }
    std::fs::write(at.join("bad.toml"), format!("{BENCH}{SQUARE}")).unwrap();
    refused(at, &[&solve[..], &["--method", "dpac"]].concat(), "out.zarr", "solve/setting");
}

/// The report compares sources of several sizes in a section with pictures, and in a table.
#[test]
fn the_report_compares_sources() {
    let dir = folder();
    let at = dir.path();
    let small = ["--views", "3", "--steps", "4", "--pupils", "4", "--display", "small", "--size", "48x64"];
    let rest = [
        "--frames",
        "1,2",
        "--pupil-diameter",
        "3.5..4.5",
        "--set",
        "compare.speckle=false",
        "--jod",
        "none",
        "--engine",
        "cpu",
    ];
    let line =
        [&["eval", "compare", "builtin:still-life", "--set=compare.coherence=0,2", "-o", "report"][..], &small, &rest]
            .concat();
    let said = done(at, &line);
    let rows = document(&at.join("report/report.json"))["coherence"].clone();
    let wide = |row: &&serde_json::Value| row["frames"] == 1 && row["image_mm"] == 2.0;
    let wide = rows.as_array().unwrap().iter().find(wide).unwrap_or_else(|| panic!("{rows}"));
    assert!(wide["modes"] == 9 && wide["pupil_modes"].as_array().map(Vec::len) == Some(2), "{wide}");
    assert!(said.lines().any(|line| line.has_sequence(&[1.0, 2.0, 9.0])), "{said}");
    let page = std::fs::read_to_string(at.join("report/report.html")).unwrap();
    assert!(page.contains("id=\"coherence\"") && page.contains("data:image/jpeg"), "{page}");
    figures_of(&at.join("report"), "report.html");
    let table = std::fs::read_to_string(at.join("report/coherence.csv")).unwrap();
    assert!(table.lines().count() == 5 && table.contains("still-life,2,0,1,1,1,1,"), "{table}");
    // The second run solves no hologram again.
    assert_eq!(done(at, &line), said);
    let wrong = ["eval", "compare", "builtin:still-life", "--set=compare.coherence=99", "-o", "other"];
    refused(at, &wrong, "other/report.html", "arguments/coherence compare.coherence 99");
}
