use super::super::SourceMode;
use super::*;
use eyebox_base::error::ErrorData;

const BENCH: &str =
    "resolution = [64, 96]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { red = 660, green = 520 }\n";

fn display(more: &str) -> Display {
    Display::from_toml(&format!("{BENCH}{more}"), "b.toml").unwrap()
}

fn grid(spacing: f64) -> String {
    let places = (0..9).map(|i| [f64::from(i % 3) - 1.0, f64::from(i / 3) - 1.0].map(|at| at * spacing));
    places.map(|[x, y]| format!("[[sources]]\neyebox_mm = [{x}, {y}]\n")).collect()
}

#[test]
fn sources_make_the_eyebox_larger() {
    let plain = display("");
    assert!((plain.eyebox_min() - 26e-3).abs() < 1e-12 && plain.regions(Color::Green).is_empty());
    let nine = display(&grid(26.0));
    assert!((nine.eyebox_min() - 78e-3).abs() < 1e-9 && (nine.source_eyebox_min() - 26e-3).abs() < 1e-12);
    assert!(nine.regions(Color::Green).is_empty(), "all of it is served");
    let reach = nine.reach();
    let sources = reach.sources.as_ref().unwrap();
    assert!(sources.eyebox_mm.iter().all(|mm| (mm - 78.0).abs() < 1e-6), "{sources:?}");
    // Along each axis, eyebox times field of view is N times the wavelength (OPTICS 12).
    let wanted = (64.0 * 520e-9) * (96.0 * 520e-9) * 1e6;
    assert!((reach.etendue_mm2_sr / wanted - 1.0).abs() < 1e-9);
    assert!((sources.etendue_mm2_sr / wanted - 9.0).abs() < 1e-6);
    assert!(
        ["9 sources", "78.0 x 78.0 mm", "9.0 times"].iter().all(|part| reach.to_string().contains(part)),
        "{reach}"
    );
    assert!(plain.reach().sources.is_none() && !plain.reach().to_string().contains("sources"));
    // At a smaller spacing they overlap, and at a larger one they leave gaps.
    let close = display(&grid(22.0)).reach().sources.unwrap();
    assert!((close.eyebox_mm[0] - 70.0).abs() < 1e-6 && (close.area_mm2 - 4900.0).abs() < 1e-3);
    let apart = display(&grid(30.0));
    assert!((apart.reach().sources.unwrap().area_mm2 - 9.0 * 676.0).abs() < 1e-3);
    assert_eq!(apart.regions(Color::Green).len(), 9);
    let one = display(&format!("sources_lit = {{ only = {{ red = [1], green = [2] }} }}\n{}", grid(26.0)));
    let [region] = one.regions(Color::Green)[..] else { panic!("one region") };
    assert!(region.center[0].abs() < 1e-12 && (region.center[1] + 26e-3).abs() < 1e-12);
}

#[test]
fn modes_of_sources_know_their_turn() {
    let centred = display("[[sources]]\nangle_mrad = [0, 0]\n");
    assert!(centred.modes(Color::Green).is_empty(), "one in the middle is none");
    let turns = |text: &str| -> Vec<[usize; 2]> { display(text).modes(Color::Green).iter().map(|m| m.turn).collect() };
    let nine = grid(26.0);
    assert_eq!(turns(&nine)[3], [3, 9]);
    assert_eq!(turns(&format!("sources_lit = \"together\"\n{nine}"))[3], SourceMode::ALWAYS);
    let steered = turns(&format!("sources_lit = \"steered\"\n{nine}"));
    assert_eq!((steered[3], steered[4]), (SourceMode::NEVER, SourceMode::ALWAYS));
    let text = "[source.green]\nimage_mm = 1\nsamples = 2\n\
                [[sources]]\nangle_mrad = [5, 0]\npower = 2\ncolors = [\"green\"]\n[[sources]]\n";
    let display = display(text);
    let modes = display.modes(Color::Green);
    assert_eq!((modes.len(), display.modes(Color::Red).len()), (8, 0));
    let of_first: f64 = modes.iter().filter(|m| m.source == 0).map(|m| m.weight).sum();
    assert!((of_first - 2.0).abs() < 1e-12);
    assert_eq!(Display::from_toml(&display.to_toml(), "b").unwrap(), display);
    // In turn, each source is brighter in its own sub-frames, so that its mean power stays the same.
    for frames in [2, 3, 7] {
        let mean = |m: &SourceMode| (0..frames).map(|f| m.power(f, frames)).sum::<f64>() / frames as f64;
        assert!(modes.iter().all(|m| (mean(m) - 1.0).abs() < 1e-12));
    }
    let alone = modes[0].in_frame(2, 4);
    assert_eq!((alone.turn, alone.weight), (SourceMode::ALWAYS, 2.0 * modes[0].weight));
    assert!(!modes[0].in_frame(1, 4).is_lit());
}

#[test]
fn sources_that_cannot_be_are_refused_in_a_line() {
    let cases = [
        ("[[sources]]\npower = 0\n", "display-file/sources-without-color"),
        ("[[sources]]\npower = -1\n", "display-file/range"),
        ("[[sources]]\npower = nan\n", "display-file/range"),
        ("[[sources]]\n[[sources]]\nangle_mrad = [0, 600]\n", "display-file/source-angle"),
        ("[[sources]]\neyebox_mm = [300, 0]\n", "display-file/source-angle"),
        ("[[sources]]\nangle_mrad = [0, 1]\neyebox_mm = [0, 1]\n", "display-file/source-place-twice"),
        ("[[sources]]\n[[sources]]\n", "display-file/sources-same-place"),
        ("[[sources]]\ncolors = [\"blue\"]\n", "display-file/no-such-color"),
        ("[[sources]]\ncolors = [\"green\"]\n", "display-file/sources-without-color"),
        ("[[sources]]\nwith = [2]\n", "display-file/source-number"),
        ("[[sources]]\nswitching_us = -3\n", "display-file/range"),
        ("[[sources]]\nangel_mrad = [0, 0]\n", "display-file/toml"),
        ("sources_lit = \"together\"\n", "display-file/lit-without-sources"),
        ("sources_lit = { only = { red = [1], green = [3] } }\n[[sources]]\n", "display-file/lit-source"),
        ("sources_lit = { only = { red = [1] } }\n[[sources]]\n", "display-file/lit-color"),
        (
            "sources_lit = \"together\"\n[[sources]]\nwith = []\n[[sources]]\nangle_mrad = [9, 0]\n",
            "display-file/lit-together",
        ),
    ];
    for (text, says) in cases {
        let error = Display::from_toml(&format!("{BENCH}{text}"), "b.toml").unwrap_err();
        assert!(error.to_string().contains("b.toml") && !error.to_string().trim_end().contains('\n'), "{error}");
        assert_eq!(ErrorData::of(&error).code, says, "{error}");
    }
    let far = format!("{BENCH}geometry = \"far-field\"\n[[sources]]\n");
    let error = Display::from_toml(&far, "b").unwrap_err();
    assert_eq!(ErrorData::of(&error).code, "display-file/sources-without-relay");
}

#[test]
fn pupils_are_taken_where_some_source_s_eyebox_is() {
    let display = display(&format!("sources_lit = \"together\"\n{}", grid(26.0)));
    let check = |x: f64, y: f64| display.check_pupil(Color::Green, Pupil::from_mm([x, y, 4.0, 0.0]));
    assert!(check(0.0, 0.0).is_ok() && check(26.0, -38.0).is_ok() && check(13.0, 13.0).is_ok());
    let said = check(60.0, 0.0).unwrap_err().to_string();
    assert!(said.contains("(60, 0) mm") && said.contains("78.00 mm"), "{said}");
    let far = self::display("[[sources]]\neyebox_mm = [40, 0]\n");
    assert!(far.check_pupil(Color::Green, Pupil::from_mm([0.0, 0.0, 4.0, 0.0])).is_err());
}
