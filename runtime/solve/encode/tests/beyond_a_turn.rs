//! Tests look-up tables that span more than a turn.

use super::*;

/// Returns the levels and the phases that they were chosen for, of a table of `count` levels.
fn chosen(turns: &dyn Fn(u32) -> f64, count: u32) -> Vec<(u32, f64)> {
    let here = here();
    let rows: String = (0..count).map(|n| format!("{n},{}\n", turns(n))).collect();
    std::fs::write(here.path().join("t.csv"), format!("level,phase_turns\n{rows}")).unwrap();
    let display = with("look_up = { red = \"t.csv\" }", here.path(), [64, 256], 256);
    let phases: Vec<f32> = (0..64 * 256).map(|i| ((f64::from(i) + 0.5) / 16384.0 * TAU) as f32).collect();
    let frames = encode(&display, &ALL[..1], 1, std::slice::from_ref(&phases));
    assert_eq!(Encoder::new(&display, &ALL[..1], 1).unwrap().notes().len(), 0);
    let decoder = Decoder::new(&display, &ALL[..1], 1, AsShown::default()).unwrap();
    let decoded = decoder.decode(&frames, |i| i.to_string()).unwrap();
    assert!(encode(&display, &ALL[..1], 1, &decoded) == frames, "levels that are shown return");
    frames.frame(0).iter().zip(&phases).map(|(level, phase)| (u32::from(*level), f64::from(*phase) / TAU)).collect()
}

/// Returns the distance of a level's phase from a phase, modulo a turn.
fn far(level_turns: f64, turns: f64) -> f64 {
    let off = level_turns - turns;
    (off - off.round()).abs()
}

/// Returns the light in dB that the chosen levels lose, and that the nearest levels of the first turn lose.
fn lost(turns: &dyn Fn(u32) -> f64, count: u32) -> [f64; 2] {
    let first: Vec<u32> = (0..count).filter(|n| turns(*n) < 1.0 - 1e-9).collect();
    let all = chosen(turns, count);
    let nearest = |phase: f64| first.iter().map(|n| far(turns(*n), phase)).fold(1.0, f64::min);
    let decibels = |error: &dyn Fn(&(u32, f64)) -> f64| {
        let mean = all.iter().map(|one| (TAU * error(one)).powi(2)).sum::<f64>() / all.len() as f64;
        mean * 10.0 / std::f64::consts::LN_10
    };
    [decibels(&|(level, phase)| far(turns(*level), *phase)), decibels(&|(_, phase)| nearest(*phase))]
}

/// The table has 2.9 pi over 8 bits in even steps. No level beyond the first turn is more than half a step of 8 bits from
/// another.
#[test]
fn even_steps_are_fine_enough_in_one_turn() {
    let turns = |n: u32| 1.45 * f64::from(n) / 255.0;
    let all = chosen(&turns, 256);
    assert!(all.iter().all(|(level, _)| turns(*level) < 1.0));
    // All levels of the turn are used.
    let used: std::collections::BTreeSet<u32> = all.iter().map(|l| l.0).collect();
    assert_eq!(used.len(), 176);
    let [chosen, first] = lost(&turns, 256);
    assert!((chosen - 0.00046).abs() < 1e-5 && (first - 0.00046).abs() < 1e-5, "{chosen} {first}");
}

/// The table has 2.9 pi over 8 bits, steep in the middle and flat at the ends, as liquid crystals have. Flat levels of
/// the second turn are between the steep ones of the first.
#[test]
fn levels_beyond_a_turn_fill_the_gaps_of_steep_steps() {
    let turns = |n: u32| 1.45 * (0.5 - 0.5 * (std::f64::consts::PI * f64::from(n) / 255.0).cos());
    let [light, first] = lost(&turns, 256);
    assert!((light - 0.00073).abs() < 1e-5 && (first - 0.00085).abs() < 1e-5, "{light} {first}");
    let all = chosen(&turns, 256);
    let used: std::collections::BTreeSet<u32> = all.iter().map(|l| l.0).collect();
    assert_eq!(used.len(), 196);
    // A level beyond the first turn is more than half a step of 8 bits from every level of the first turn.
    for (level, _) in all.iter().filter(|(level, _)| turns(*level) >= 1.0) {
        let alone = (0..256).filter(|n| turns(*n) < 1.0).map(|n| far(turns(n), turns(*level))).fold(1.0, f64::min);
        assert!(alone > 1.0 / 512.0, "{level}: {alone}");
    }
}

/// All of 16 levels over 2.9 pi are used, and less light is lost.
#[test]
fn few_levels_are_all_used() {
    let turns = |n: u32| 1.45 * f64::from(n) / 15.0;
    let all = chosen(&turns, 16);
    let used: std::collections::BTreeSet<u32> = all.iter().map(|l| l.0).collect();
    assert_eq!(used.len(), 16);
    for (level, phase) in &all {
        let best = (0..16).map(|n| far(turns(n), *phase)).fold(1.0, f64::min);
        assert!(far(turns(*level), *phase) <= best + 2.0 / 65536.0, "{phase} became {level}");
    }
    let [light, first] = lost(&turns, 16);
    assert!((light - 0.086).abs() < 1e-3 && (first - 0.130).abs() < 1e-3, "{light} {first}");
}

/// A part of the first turn that has no level is reached a turn later.
#[test]
fn a_gap_of_the_first_turn_is_filled_from_the_next() {
    let turns = |n: u32| if n < 100 { f64::from(n) / 200.0 } else { 0.7 + f64::from(n - 100) / 150.0 };
    let [light, first] = lost(&turns, 255);
    assert!(first > 0.1 && light < 0.002, "{light} {first}");
}
