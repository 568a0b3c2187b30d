//! Tests ten minutes of a simulated eye before 3 x 3 switchable sources.
//!
//! One test runs the decisions alone. Sets are made as in a session, each for the sources that are chosen for it, and
//! take as long as steps and encoding may take. The others run whole sessions on a simulated clock, for a quarter of a
//! minute each. `EYEBOX_SOAK=full` makes them ten minutes.

use crate::optics::{Color, Display, Pupil, SourceChoice, SourcesLit, SwitchedSource};
use crate::present::SECOND_NS;
use crate::session::scripted::{Application, ShownFrame, samples, shown};
use crate::session::soak_tests::{is_full, nothing_is_torn};
use crate::session::stage::Scripted;
use crate::session::{Cost, LitSources};
use crate::solve::SplitMix;
use crate::trackers::simulated::{Doing, Eye, Settings as EyeSettings};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// A set with the sources that light it and the sources that it was made for.
#[derive(Clone)]
struct Set {
    lit: Vec<usize>,
    made_for: Vec<usize>,
}

/// Counts of the sets that were lit while the lid was open. The count `unlit_or_torn` is of sets lit by no source or by
/// other sources than their own. The count `dark` is of sets that a resting eye could not see, and the next field is
/// the longest time of that after a landing (ms). The last fields count changes of the sources, and sets lit by several
/// sources.
#[derive(Debug, Default)]
struct Seen {
    sets: usize,
    unlit_or_torn: usize,
    dark: usize,
    dark_after_ms: f64,
    hand_overs: usize,
    by_several: usize,
}

/// An eyepiece of 133 mm has an eyebox of 8.7 mm. An eye that looks 30 degrees to the side moves its pupil by 5.7 mm.
fn display(spacing: f64) -> Display {
    let mut display = Display { focal_length: 0.133, height: 16, width: 16, ..Display::preset("planes8").unwrap() };
    display.wavelengths.retain(|w| w.color == Color::Green);
    let place = |i: usize| [i % 3, i / 3].map(|at| spacing * 1e3 * (at as f64 - 1.0));
    display.sources.each =
        (0..9).map(|i| SwitchedSource { eyebox_mm: Some(place(i)), ..SwitchedSource::default() }).collect();
    display.sources.lit = SourcesLit::Steered;
    display
}

/// Returns an eye that looks up to 30 degrees to the side, with two to four saccades per second.
fn eye(seed: u64) -> EyeSettings {
    EyeSettings {
        seed,
        field: [30f64.to_radians(), 20f64.to_radians()],
        fixation: [0.15, 0.6],
        pursuit: 0.2,
        ..EyeSettings::default()
    }
}

impl Seen {
    /// Counts a set that is lit by `lit` after `before`. `served` is the share of the light of the pupil.
    fn set(&mut self, [lit, before]: [&[usize]; 2], served: f64, rests_for_ms: Option<f64>) {
        self.sets += 1;
        self.by_several += usize::from(lit.len() > 1);
        self.hand_overs += usize::from(lit != before);
        if let Some(ms) = rests_for_ms.filter(|_| served == 0.0) {
            self.dark += 1;
            self.dark_after_ms = self.dark_after_ms.max(ms);
        }
    }
}

/// Returns the time that an eye has rested since its last saccade landed (ms), or `None` during a saccade.
fn rested_ms(doing: Doing, landed_ns: &mut u64, now_ns: u64) -> Option<f64> {
    if let Doing::Saccade { lands_ns, .. } = doing {
        *landed_ns = lands_ns;
        return None;
    }
    Some(now_ns.saturating_sub(*landed_ns) as f64 * 1e-6)
}

fn watched(spacing: f64, seconds: f64, seed: u64) -> Seen {
    let eye = eye(seed);
    let (mut truth, mut watch, mut noise) = (Eye::new(eye.clone(), 0), samples(eye), SplitMix(seed));
    let mut choice = SourceChoice::new(&display(spacing), Color::Green).unwrap();
    let (period_ns, lead_ns) = (1_000_000_000 / 60, 4_000_000);
    let first = choice.lit().to_vec();
    let mut shown = Set { lit: first.clone(), made_for: first };
    let (mut waiting, mut free_ns): (Option<(i64, Set)>, i64) = (None, 0);
    let (mut seen, mut landed_ns, mut before) = (Seen::default(), 0u64, Vec::new());
    for start_ns in (1..).map(|i| i * period_ns).take_while(|t| (*t as f64) < seconds * 1e9) {
        let light_ns = (start_ns + period_ns / 2) as u64;
        // A set that was handed over by then goes to the screen with its sources. Until then the old set keeps its own.
        if let Some((_, set)) = waiting.take_if(|(done_ns, _)| *done_ns <= start_ns - lead_ns) {
            shown = set;
        }
        if free_ns <= start_ns && waiting.is_none() {
            // The set is made for a light that can be reached. Some sets take a long time.
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
        let rests_for_ms = rested_ms(now.doing, &mut landed_ns, light_ns);
        if now.lid < 0.5 {
            continue;
        }
        let [x, y] = now.position;
        let served = choice.served(&shown.lit, &Pupil { x, y, diameter: now.diameter, depth: 0.0 });
        seen.unlit_or_torn += usize::from(shown.lit.is_empty() || shown.lit != shown.made_for);
        seen.set([&shown.lit, &before], served, rests_for_ms);
        before.clone_from(&shown.lit);
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

/// In a whole session on its simulated clock, every set that is shown was announced once with sources of its own, and
/// the sources change with the eye. Two eyeboxes overlap by 2.7 mm, and the pupil moves by 4.6 mm.
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

/// The sources of each set of a session by its number, and the time of the announcement (ns).
type Told = BTreeMap<u64, (Vec<usize>, i64)>;

/// Returns the counts for an eye in a session with these video frames, one per set.
fn met(frames: &[ShownFrame], told: &Told, eye: EyeSettings, choice: &SourceChoice, period_ns: i64) -> Seen {
    let (mut truth, mut seen, mut landed_ns, mut before) = (Eye::new(eye, 0), Seen::default(), 0, Vec::new());
    for frame in frames {
        let Some((lit, since_ns)) = frame.set.map(|set| &told[&set]) else { continue };
        let light_ns = (frame.begins_ns + period_ns / 2) as u64;
        let now = truth.at(light_ns);
        let rests_for_ms = rested_ms(now.doing, &mut landed_ns, light_ns);
        if now.lid < 0.5 {
            continue;
        }
        let [x, y] = now.position;
        let served = choice.served(lit, &Pupil { x, y, diameter: now.diameter, depth: 0.0 });
        seen.unlit_or_torn += usize::from(lit.is_empty() || *since_ns > frame.begins_ns);
        seen.set([lit, &before], served, rests_for_ms);
        before.clone_from(lit);
    }
    seen
}

/// In whole sessions on the simulated clock, every set is lit by its announced sources from its first video frame on.
/// No set is torn, and none is dark to an eye that rests.
#[test]
fn in_whole_sessions_no_set_is_dark_or_torn() {
    let (rate, seconds) = (60, if is_full() { 600.0 } else { 15.0 });
    let eyebox = 520e-9 * 0.133 / 8e-6;
    for (spacing, step_ms, seed) in [(eyebox, 2, 11), (eyebox - 4e-3, 6, 12)] {
        let display = display(spacing);
        let choice = SourceChoice::new(&display, Color::Green).unwrap();
        let stage = Scripted::before(display, 2);
        let app = Application::new(&stage, 30, [0, i64::MAX]);
        let step = Duration::from_millis(step_ms);
        let mut live = stage.live_before(app, Cost::Fixed { step, encode: step / 8 }, eye(seed));
        let told = Arc::new(Mutex::new(Told::new()));
        let theirs = Arc::clone(&told);
        live.switch = Some(Box::new(move |lit: &LitSources<'_>| {
            let before = theirs.lock().unwrap().insert(lit.set, (lit.colors[0].clone(), lit.start_ns));
            assert!(before.is_none(), "set {} is lit anew", lit.set);
        }));
        let (statistics, frames) = shown(live, rate, seconds);
        let told = told.lock().unwrap();
        let what = format!("spaced by {:.2} mm, steps of {step_ms} ms", spacing * 1e3);
        nothing_is_torn(&frames, &what);
        assert_eq!(told.len() as u64, statistics.live.unwrap().sets_new, "{what}");
        let seen = met(&frames, &told, eye(seed), &choice, SECOND_NS / i64::from(rate));
        println!("{what}: {} new sets, {seen:?}", told.len());
        assert!(seen.sets as f64 > 40.0 * seconds && seen.hand_overs as f64 > 0.5 * seconds, "{what}: {seen:?}");
        assert_eq!((seen.unlit_or_torn, seen.dark), (0, 0), "{what}: {seen:?}");
    }
}
