//! A static etendue-expanding phase mask in front of the SLM, from the display file to the picture.

use crate::common::{Printed, attributes, command, document, done, folder, json, refused, text, with_json_errors};
use eyebox::low_level::files::{read_npy, write_npy};

const BENCH: &str =
    "resolution = [48, 48]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n";

/// A hologram stores the mask through which it was solved. Its views use this mask even if the mask's file is gone, and
/// also beyond the SLM's own eyebox. A mask without phases and without finer pixels changes no byte.
#[test]
fn a_hologram_keeps_its_mask() {
    let dir = folder();
    let at = dir.path();
    let phases: Vec<f32> = (0..96 * 96).map(|i: u32| (i.wrapping_mul(2_654_435_761) >> 16) as f32 * 1e-4).collect();
    write_npy(&at.join("mask.npy"), &[96, 96], &phases).unwrap();
    write_npy(&at.join("clear.npy"), &[48, 48], &[0.0; 48 * 48]).unwrap();
    let display = |name: &str, mask: &str| std::fs::write(at.join(name), format!("{BENCH}{mask}")).unwrap();
    display("plain.toml", "");
    display("clear.toml", "[mask]\nfactor = 1\nfile = \"clear.npy\"\n");
    display("mask.toml", "[mask]\nfactor = 2\nfile = \"mask.npy\"\n");
    let settings = ["--steps", "10", "--frames", "2", "--pupil-diameter", "3.5..4.5", "--engine", "cpu"];
    let solve = |display: &str, out: &str| {
        let first = ["solve", "builtin:still-life", "--display", display, "-o", out];
        done(at, &[&first[..], &settings].concat());
    };
    let view = |hologram: &str, out: &str, more: &[&str]| {
        let pupil = ["--pupil", "18,-1,4,0", "--engine", "cpu", "-o", out];
        let mut command = command(at, &[&["render", hologram][..], &pupil, more].concat());
        let answer = with_json_errors(&mut command).output().expect("it starts");
        (answer.status.success(), text(&answer.stderr))
    };
    solve("plain.toml", "plain.zarr");
    solve("clear.toml", "clear.zarr");
    solve("mask.toml", "mask.zarr");
    let chunk = |name: &str| std::fs::read(at.join(name).join("phases/c/0/0/0/0"));
    assert_eq!(chunk("plain.zarr").unwrap(), chunk("clear.zarr").unwrap());
    std::fs::remove_file(at.join("mask.npy")).unwrap();
    // 18 mm from the axis is outside the SLM's own eyebox of 26 mm and inside the 52 mm with the mask.
    let (seen, said) = view("plain.zarr", "plain.npy", &[]);
    assert!(!seen && said.contains("\"arguments/outside-eyebox\""), "{said}");
    let (seen, said) = view("mask.zarr", "masked.npy", &[]);
    assert!(seen && said.has("--ideal") && said.has_sequence(&[2.0, 2.0]), "{said}");
    assert_eq!(read_npy(&at.join("masked.npy")).unwrap().shape, [48, 48]);
    assert!(!view("mask.zarr", "past.npy", &["--ideal"]).0);
    let score = |hologram: &str| {
        let line = ["eval", "score", hologram, "builtin:still-life", "--json", "--jod", "none", "--engine", "cpu"];
        let said = done(at, &[&line[..], &["--pupil-diameter", "4..4"]].concat());
        serde_json::from_str::<serde_json::Value>(&said).unwrap()["psnr_db"]["mean"].as_f64().unwrap()
    };
    let before = score("mask.zarr");
    assert!(before > 12.0, "{before}");
    let refine = ["refine", "mask.zarr", "builtin:still-life", "--pupil=18,-1,4,0", "--steps", "6", "--engine", "cpu"];
    done(at, &[&refine[..], &["-o", "refined.zarr"]].concat());
    let (seen, said) = view("refined.zarr", "refined.npy", &[]);
    assert!(seen && said.has("--ideal") && said.has_sequence(&[2.0, 2.0]), "{said}");
    let factor = |hologram: &str| attributes(&at.join(hologram))["settings"]["mask"]["factor"].clone();
    assert_eq!(["plain.zarr", "mask.zarr", "refined.zarr"].map(factor), [serde_json::Value::Null, 2.into(), 2.into()]);
    // The plan reports the cost of the mask, and `display check` reports its effect on the eyebox.
    display("mask.toml", "[mask]\nfactor = 2\nseed = 3\nband = 0.5\ndistance_mm = 1\n");
    let plan = [&["solve", "builtin:still-life", "--dry-run", "--display", "mask.toml"][..], &settings].concat();
    let planned = json(at, &[&plan[..], &["--json"]].concat());
    let choice = planned["choices"].as_array().unwrap().iter().find(|c| c["what"] == "mask").expect("a mask");
    let [value, why] = ["value", "why"].map(|key| choice[key].as_str().unwrap());
    assert!(value.has_sequence(&[2.0, 2.0]) && why.has("52 26 mm"), "{choice}");
    assert!(done(at, &plan).lines_with("52 26 mm") > 0);
    let devices = ["display", "check", "mask.toml"];
    let reach = &json(at, &[&devices[..], &["--json"]].concat())["reach"];
    let [own, plain] = [&reach["eyebox_mm"], &reach["without_mask"]["eyebox_mm"]].map(|mm| mm.as_f64().unwrap());
    assert!((own - 52.0).abs() < 1e-6 && (plain - 26.0).abs() < 1e-6, "{reach}");
    assert_eq!(done(at, &devices).lines_with("52 26 mm"), 1);
    solve("mask.toml", "away.zarr");
    assert!(view("away.zarr", "away.npy", &[]).0);
}

#[test]
fn a_mask_that_cannot_be_is_refused_in_a_line() {
    let dir = folder();
    let at = dir.path();
    let solve = ["solve", "builtin:still-life", "--display", "bad.toml", "--engine", "cpu", "-o", "out.zarr"];
    for (mask, says) in [
        ("factor = 9\nseed = 1\n", "range 9"),
        ("factor = 2\n", "mask-without-phases"),
        ("factor = 2\nfile = \"none.npy\"\n", "read none.npy"),
    ] {
        std::fs::write(at.join("bad.toml"), format!("{BENCH}[mask]\n{mask}")).unwrap();
        refused(at, &solve, "out.zarr", &format!("optics/display-file/{says} bad.toml [mask]"));
    }
    std::fs::write(at.join("bad.toml"), format!("{BENCH}[mask]\nfactor = 2\nseed = 1\n")).unwrap();
    refused(at, &[&solve[..], &["--method", "dpac"]].concat(), "out.zarr", "solve/setting");
    refused(at, &[&solve[..], &["--method", "stft"]].concat(), "out.zarr", "solve/setting");
}

/// The report compares masks and their eyeboxes in a section with pictures, in a table and in JSON.
#[test]
fn the_report_compares_masks() {
    let dir = folder();
    let at = dir.path();
    let small = ["--views", "3", "--steps", "4", "--pupils", "4", "--display", "small", "--size", "48x48"];
    let rest = [
        "--frames",
        "1",
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
        [&["eval", "compare", "builtin:still-life", "--set=compare.etendue=3,1,2d", "-o", "report"][..], &small, &rest]
            .concat();
    let said = done(at, &line);
    // Each row has the factor of a mask and its eyebox in mm.
    let rows = document(&at.join("report/report.json"))["etendue"].clone();
    let rows = rows.as_array().unwrap().iter().map(|r| [&r["factor"], &r["eyebox_mm"]].map(|v| v.as_f64().unwrap()));
    let rows: Vec<[f64; 2]> = rows.map(|row| row.map(f64::round)).collect();
    assert_eq!(rows, [[1.0, 22.0], [2.0, 44.0], [3.0, 66.0]]);
    assert!(rows.iter().all(|[_, mm]| said.lines_with(&format!("{mm} mm")) == 1), "{said}");
    let page = std::fs::read_to_string(at.join("report/report.html")).unwrap();
    assert!(page.contains("id=\"etendue\"") && page.matches("data:image/jpeg").count() == 3, "{page}");
    let table = std::fs::read_to_string(at.join("report/etendue.csv")).unwrap();
    let kept = table.lines().skip(1).map(|line| {
        let cells: Vec<&str> = line.split(',').skip(3).take(2).collect();
        [0, 1].map(|i| cells[i].parse::<f64>().unwrap().round())
    });
    assert_eq!(kept.collect::<Vec<_>>(), rows, "{table}");
    // The second run solves no hologram again.
    assert_eq!(done(at, &line), said);
    let json = done(at, &[&line[..], &["--json"]].concat());
    let rows = serde_json::from_str::<serde_json::Value>(&json).unwrap()["etendue"].as_array().unwrap().len();
    assert_eq!(rows, 3);
    let wrong = ["eval", "compare", "builtin:still-life", "--set=compare.etendue=5", "-o", "other"];
    refused(at, &wrong, "other/report.html", "arguments/settings-value compare.etendue");
}

/// Behind a mask, the default methods are the methods that support one. Results of another mask are not used.
#[test]
fn a_masked_display_is_evaluated() {
    let dir = folder();
    let at = dir.path();
    let display = |seed: u32| {
        let mask = format!("{BENCH}[mask]\nfactor = 3\nseed = {seed}\n");
        std::fs::write(at.join("mask.toml"), mask).unwrap();
    };
    let line = ["eval", "compare", "builtin:still-life", "--display", "mask.toml", "-o", "report", "--json"];
    let small = ["--views", "3", "--steps", "2", "--pupils", "2", "--frames", "1"];
    let rest = ["--set", "compare.speckle=false", "--jod", "none", "--engine", "cpu"];
    let evaluate = || {
        let said = done(at, &[&line[..], &small, &rest].concat());
        serde_json::from_str::<serde_json::Value>(&said).unwrap()["over_scenes"].clone()
    };
    display(1);
    let first = evaluate();
    let names: Vec<&str> = first.as_array().unwrap().iter().map(|s| s["method"].as_str().unwrap()).collect();
    assert_eq!(names, ["slfh", "lf2fs", "smooth"]);
    assert_eq!(evaluate(), first);
    display(2);
    assert_ne!(evaluate(), first);
}
