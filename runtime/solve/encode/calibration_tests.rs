//! Tables as laboratories write them: read right, or refused with the forms that are read.

use super::*;
use proptest::prelude::*;

/// Two levels half a turn apart, however they are written.
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
        let turns = |level: u8| table.iter().find(|l| l.0 == level).unwrap().1;
        assert!(table.len() == 2 && turns(0) == 0.0 && (turns(255) - 0.5).abs() < 1e-9, "{text}: {table:?}");
    }
}

/// 256 levels that reach so far.
fn table(head: &str, reach: f64) -> String {
    let row = |level: u32| format!("{level},{:.6}\n", f64::from(level) / 255.0 * reach);
    format!("{head}\n{}", (0..256).map(row).collect::<String>())
}

#[test]
fn without_a_unit_only_what_can_be_nothing_but_radians_is_read() {
    for head in ["", "level,phase", "# a comment"] {
        for (reach, says) in [
            (std::f64::consts::TAU, None),
            (14.5, None),
            (4.9, Some("in radians or 2.450 turns in units of pi")),
            (2.0, Some("1.000 turns in units of pi or 2.000 turns in turns")),
            (1.0, Some("1.000 turns in turns")),
            (360.0, Some("1.000 turns in degrees")),
            (720.0, Some("2.000 turns in degrees")),
            (100.0, Some("0.278 turns in degrees")),
            (4000.0, Some("no unit that is known")),
        ] {
            match (parse(&table(head, reach), 256), says) {
                (Ok(read), None) => assert!((read[255].1 - reach / std::f64::consts::TAU).abs() < 1e-6),
                (Err((_, reason)), Some(says)) => {
                    assert!(reason.contains(says) && reason.contains("level,phase_rad"), "{head} {reach}: {reason}");
                }
                (found, _) => panic!("{head} {reach}: {:?}", found.map(|t| t[255])),
            }
        }
    }
    // Nor can one unit be taken for another that was named.
    for (head, reach, says) in [
        ("level,phase_rad", 360.0, "1.000 turns in degrees"),
        ("level,phase_rad", 1.0, "an SLM reaches"),
        ("level,phase_deg", std::f64::consts::TAU, "1.000 turns in radians"),
        ("level,phase_pi", 360.0, "1.000 turns in degrees"),
        ("level,phase_turns", 360.0, "1.000 turns in degrees"),
    ] {
        let (_, reason) = parse(&table(head, reach), 256).unwrap_err();
        assert!(reason.contains(says), "{head} {reach}: {reason}");
    }
}

#[test]
fn the_wrong_line_is_named() {
    for (text, line, what) in [
        ("0,0\n1,x\n", 2, "phase 'x'"),
        ("0,0\n1\n", 2, "columns"),
        ("level,phase\n0,0\n\n#\n256,1\n", 5, "0 to 255"),
        ("level,phase\n0,0\n0,1\n", 3, "second time"),
        ("level,phase_mm\n0,0\n", 1, "'mm' is no unit"),
        ("level,phase (deg rad)\n0,0\n", 1, "two units"),
        ("voltage,current\n0,0\n", 1, "does not name"),
        ("0,0,0\n1,1,1\n", 1, "3 columns"),
        ("0,nan\n1,2", 1, "nan"),
        ("0,0\n1,inf", 2, "inf"),
        ("0,0\n", 1, "at least two"),
        ("", 1, "at least two"),
        ("0,0\nlevel,phase\n", 2, "level"),
        ("0 0\n1 6\n", 1, "either column"),
        ("0;1,5\n1;2.5,0\n", 2, "2.5,0"),
    ] {
        let (at, reason) = parse(text, 256).unwrap_err();
        assert!(at == line && reason.contains(what), "{text:?}: line {at}: {reason}");
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
