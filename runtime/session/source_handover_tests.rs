//! Ten minutes of a simulated eye before 3 x 3 switchable sources, as decisions alone: sets are made when they are made in a
//! session, each for the sources that are chosen for it, and take as long as steps and encoding may take.

use super::scripted::{Application, Scripted, samples, shown};
use super::{Cost, LitSources};
use crate::optics::{Color, Display, Pupil, SourceChoice, SourcesLit, SwitchedSource};
use crate::solve::SplitMix;
use crate::trackers::simulated::{Doing, Eye, Settings as EyeSettings};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// A set: what it is lit by, and what it was made for.
#[derive(Clone)]
struct Set {
    lit: Vec<usize>,
    made_for: Vec<usize>,
}

/// Of sets that were lit while the lid was open: all; lit by nothing, or by other sources than theirs; those of which the eye saw
/// nothing while it rested, and the longest time after a landing at which it did, ms; hand-overs; sets lit by several sources.
#[derive(Debug, Default)]
struct Seen {
    sets: usize,
    unlit_or_torn: usize,
    dark: usize,
    dark_after_ms: f64,
    hand_overs: usize,
    by_several: usize,
}

/// An eyepiece of 133 mm has an eyebox of 8.7 mm; an eye that looks 30 degrees to the side moves its pupil by 5.7.
fn display(spacing: f64) -> Display {
    let mut display = Display { focal_length: 0.133, ..Display::preset("small").unwrap() };
    display.wavelengths.retain(|w| w.color == Color::Green);
    let place = |i: usize| [i % 3, i / 3].map(|at| spacing * 1e3 * (at as f64 - 1.0));
    display.sources.each =
        (0..9).map(|i| SwitchedSource { eyebox_mm: Some(place(i)), ..SwitchedSource::default() }).collect();
    display.sources.lit = SourcesLit::Steered;
    display
}

fn watched(spacing: f64, seconds: f64, seed: u64) -> Seen {
    let eye = EyeSettings {
        seed,
        field: [30f64.to_radians(), 20f64.to_radians()],
        fixation: [0.15, 0.6],
        pursuit: 0.2,
        ..EyeSettings::default()
    };
    let (mut truth, mut watch, mut noise) = (Eye::new(eye.clone(), 0), samples(eye), SplitMix(seed));
    let mut choice = SourceChoice::new(&display(spacing), Color::Green).unwrap();
    let (period_ns, lead_ns) = (1_000_000_000 / 60, 4_000_000);
    let first = choice.lit().to_vec();
    let mut shown = Set { lit: first.clone(), made_for: first };
    let (mut waiting, mut free_ns): (Option<(i64, Set)>, i64) = (None, 0);
    let (mut seen, mut landed_ns, mut before) = (Seen::default(), 0u64, Vec::new());
    for start_ns in (1..).map(|i| i * period_ns).take_while(|t| (*t as f64) < seconds * 1e9) {
        let light_ns = (start_ns + period_ns / 2) as u64;
        // What was handed over by then takes the screen with its sources; until then the old set stays with its own.
        if let Some((_, set)) = waiting.take_if(|(done_ns, _)| *done_ns <= start_ns - lead_ns) {
            shown = set;
        }
        if free_ns <= start_ns && waiting.is_none() {
            // A set for one that can be reached: now and then a long one.
            let takes_ns = 3_000_000 + (noise.unit().powi(3) * 40e6) as i64;
            let begins_ns = free_ns.max(start_ns - period_ns);
            let for_ns = (begins_ns + takes_ns + lead_ns).div_euclid(period_ns) * period_ns + 3 * period_ns / 2;
            let expected = watch.expect(begins_ns as u64, for_ns as u64).unwrap();
            choice.follow(&expected.pupil);
            let lit = choice.lit().to_vec();
            waiting = Some((begins_ns + takes_ns, Set { lit: lit.clone(), made_for: lit }));
            free_ns = begins_ns + takes_ns;
        }
        let now = truth.at(light_ns);
        let flies = match now.doing {
            Doing::Saccade { lands_ns, .. } => {
                landed_ns = lands_ns;
                true
            }
            _ => false,
        };
        if now.lid < 0.5 {
            continue;
        }
        let [x, y] = now.position;
        let served = choice.served(&shown.lit, &Pupil { x, y, diameter: now.diameter, depth: 0.0 });
        seen.sets += 1;
        seen.unlit_or_torn += usize::from(shown.lit.is_empty() || shown.lit != shown.made_for);
        seen.by_several += usize::from(shown.lit.len() > 1);
        seen.hand_overs += usize::from(shown.lit != before);
        before.clone_from(&shown.lit);
        if served == 0.0 && !flies {
            seen.dark += 1;
            seen.dark_after_ms = seen.dark_after_ms.max(light_ns.saturating_sub(landed_ns) as f64 * 1e-6);
        }
    }
    seen
}

#[test]
fn in_ten_minutes_of_saccades_no_set_is_dark_or_torn() {
    let eyebox = 520e-9 * 0.133 / 8e-6;
    for spacing in [eyebox, eyebox - 4e-3] {
        let seen = watched(spacing, 600.0, 11);
        println!("spaced by {:.2} mm: {seen:?}", spacing * 1e3);
        assert!(seen.sets > 25_000 && seen.hand_overs > 300, "{seen:?}");
        assert_eq!((seen.unlit_or_torn, seen.dark), (0, 0), "{seen:?}");
    }
}

/// In a whole session, on its simulated clock: every set that is shown was announced with sources of its own, once, and they change
/// with the eye. Two eyeboxes that overlap by 2.7 mm, before an eye that moves by 4.6.
#[test]
fn a_session_switches_sources_with_its_sets() {
    let mut display = Display { height: 16, width: 16, ..Display::preset("planes8").unwrap() };
    display.focal_length = 0.133;
    display.sources.each =
        [-3.0, 3.0].map(|x| SwitchedSource { eyebox_mm: Some([x, 0.0]), ..SwitchedSource::default() }).to_vec();
    display.sources.lit = SourcesLit::Steered;
    let stage = Scripted::before(display, 2);
    let app = Application::new(&stage, 30, [0, i64::MAX]);
    let step = Duration::from_millis(3);
    let mut live = stage.live(app, Cost::Fixed { step, encode: step / 8 }, 5);
    let told = Arc::new(Mutex::new(BTreeMap::new()));
    let theirs = Arc::clone(&told);
    live.switch = Some(Box::new(move |lit: &LitSources<'_>| {
        let before = theirs.lock().unwrap().insert(lit.set, lit.colors.to_vec());
        assert!(before.is_none(), "set {} is lit anew", lit.set);
    }));
    let (statistics, frames) = shown(live, 60, 20.0);
    let told = told.lock().unwrap();
    assert_eq!(told.len() as u64, statistics.live.unwrap().sets_new);
    assert!(told.values().all(|colors| colors.len() == 1 && !colors[0].is_empty()), "{told:?}");
    let kinds: BTreeSet<&Vec<usize>> = told.values().map(|colors| &colors[0]).collect();
    assert!(kinds.len() == 3, "each alone, and both between: {kinds:?}");
    let sets: BTreeSet<u64> = frames.iter().filter_map(|frame| frame.set).collect();
    assert!(sets.len() > 500 && sets.iter().all(|set| told.contains_key(set)), "{} sets", sets.len());
}
