//! Tests tables in the forms of laboratories, which are read correctly or refused with the supported forms.

use super::super::tests::numbers;
use super::*;
use proptest::prelude::*;

/// Two levels half a turn apart, in many forms.
#[test]
fn tables_of_laboratories_are_read() {
    for text in [
        "level,phase_rad\n0,0\n255,3.14159265358979",
        "level,phase_pi\n0,0\n255,1.0\n",
        "# bench, May\nLevel;phase_turns\n\n0;0\r\n255;0.5\r\n",
        "\u{feff}level\tphase_deg\n255\t180\n0\t0",
        "Gray level,Phase (rad)\n0,0.0\n255,3.14159265358979\n",
        "Grey Level;Phase [pi]\n0;0\n255;1",
        "\"Gray level\";\"Phase [\u{3c0}]\"\n0;0,0\n255;1,0",
        "Phase (deg), Gray Level\n0.0, 0\n180.0, 255",
        "Phase [\u{b0}]\tGL\n0\t0\n180\t255",
        "% level phase/pi\n0 0\n255 1",
        "# level,phase_deg\n0.000000e+00,0.000000e+00\n2.550000e+02,1.800000e+02\n",
        "# measured in May\n# Gray level, Phase (2 pi)\n0, 0\n255, 0.5",
        "Gray level   Phase (x pi rad)\n0   0.0\n255  1.0",
        "gray level,intensity,phase [waves]\n0,0.9,0\n255,0.8,0.5",
        "level\tdeg\n0\t0,0\n255\t180,0\n",
        "Graylevel\tPhase shift in rad\n0\t0,0\n255\t3,14159265358979\n",
    ] {
        let table = parse(text, 256).unwrap_or_else(|e| panic!("{text}: {e:?}"));
        let turns = |level: u16| table.iter().find(|l| l.0 == level).unwrap().1;
        assert!(table.len() == 2 && turns(0) == 0.0 && (turns(255) - 0.5).abs() < 1e-9, "{text}: {table:?}");
    }
}

/// Returns a table of 256 levels that reach this phase.
fn table(head: &str, reach: f64) -> String {
    let row = |level: u32| format!("{level},{:.6}\n", f64::from(level) / 255.0 * reach);
    format!("{head}\n{}", (0..256).map(row).collect::<String>())
}

/// Returns the numbers of turns, which have three digits.
fn turns(reason: &Reason) -> Vec<&str> {
    numbers(reason.text())
        .into_iter()
        .filter(|n| n.split_once('.').is_some_and(|(_, digits)| digits.len() == 3))
        .collect()
}

#[test]
fn without_a_unit_only_what_can_be_nothing_but_radians_is_read() {
    for head in ["", "level,phase", "# a comment"] {
        for (reach, could_be) in [
            (std::f64::consts::TAU, None),
            (14.5, None),
            (4.9, Some(&["0.780", "2.450"][..])),
            (2.0, Some(&["1.000", "2.000"])),
            (1.0, Some(&["1.000"])),
            (360.0, Some(&["1.000"])),
            (720.0, Some(&["2.000"])),
            (100.0, Some(&["0.278"])),
            (4000.0, Some(&[])),
        ] {
            match (parse(&table(head, reach), 256), could_be) {
                (Ok(read), None) => assert!((read[255].1 - reach / std::f64::consts::TAU).abs() < 1e-6),
                (Err((_, reason)), Some(could_be)) => {
                    assert_eq!((reason.code(), &turns(&reason)[..]), ("no-unit", could_be), "{head} {reach}: {reason}");
                    assert!(reason.text().contains("level,phase_rad"), "{reason}");
                }
                (found, _) => panic!("{head} {reach}: {:?}", found.map(|t| t[255])),
            }
        }
    }
    // A named unit cannot be mistaken for another either.
    for (head, reach, is) in [
        ("level,phase_rad", 360.0, "57.296"),
        ("level,phase_rad", 1.0, "0.159"),
        ("level,phase_deg", std::f64::consts::TAU, "0.017"),
        ("level,phase_pi", 360.0, "180.000"),
        ("level,phase_turns", 360.0, "360.000"),
    ] {
        let (_, reason) = parse(&table(head, reach), 256).unwrap_err();
        assert_eq!((reason.code(), &turns(&reason)[..]), ("span", &[is, "1.000"][..]), "{head} {reach}: {reason}");
    }
}

#[test]
fn the_wrong_line_is_named() {
    for (text, line, code, what) in [
        ("0,0\n1,x\n", 2, "phase", "'x'"),
        ("0,0\n1\n", 2, "columns-count", "1"),
        ("level,phase\n0,0\n\n#\n256,1\n", 5, "level", "255"),
        ("level,phase\n0,0\n0,1\n", 3, "level-twice", "0"),
        ("level,phase_mm\n0,0\n", 1, "unit", "'mm'"),
        ("level,phase (deg rad)\n0,0\n", 1, "two-units", "phase (deg rad)"),
        ("voltage,current\n0,0\n", 1, "columns", "voltage,current"),
        ("0,0,0\n1,1,1\n", 1, "columns-not-named", "3"),
        ("0,nan\n1,2", 1, "phase", "nan"),
        ("0,0\n1,inf", 2, "phase", "inf"),
        ("0,0\n", 1, "levels-count", "1"),
        ("", 1, "levels-count", "0"),
        ("0,0\nlevel,phase\n", 2, "level", "'level'"),
        ("0 0\n1 6\n", 1, "levels-in-either", ""),
        ("0;1,5\n1;2.5,0\n", 2, "phase", "2.5,0"),
    ] {
        let (at, reason) = parse(text, 256).unwrap_err();
        assert_eq!((at, reason.code()), (line, code), "{text:?}: {reason}");
        assert!(reason.text().contains(what), "{text:?}: {reason}");
    }
}

proptest! {
    #[test]
    fn any_text_is_read_or_refused(text in "[0-9,;.\\-e\n#a-z()\t ]{0,200}", levels in 2u32..=300) {
        if let Ok(table) = parse(&text, levels) {
            prop_assert!(table.len() >= 2 && table.iter().all(|l| u32::from(l.0) < levels && l.1.is_finite()));
        }
    }
}
