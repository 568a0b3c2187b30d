//! The attack runs the command with generated inputs, options, streams and limits, and checks how it ends.
//!
//! A case is one run of `eyebox` on holograms and scenes of a few pixels. Every case ends with 0, or with 2, an error
//! line and no output. A case never ends by a signal, with a panic, with too much memory or more than five seconds
//! after ctrl-C. All other files stay unchanged. The same seed gives the same cases.
//!
//! `EYEBOX_ATTACK_CASES=20000 EYEBOX_ATTACK_SEED=7 cargo test --workspace --test attack -- --nocapture` runs 20000
//! cases and prints a table of their answers. `EYEBOX_ATTACK_ONLY=options` runs one kind of case.
//! `EYEBOX_ATTACK_FIRST=1234` begins with that case.
#![cfg(target_os = "linux")]

mod answer;
mod bombs;
mod case;
mod fields;
mod ground;
mod kills;
mod limits;
mod options;
mod sizes;
mod soak;
mod special;
mod streams;

use answer::Answer;
use case::Case;
use ground::Ground;
use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Makes one case out of random numbers.
type Generator = fn(&Ground, &mut fastrand::Rng) -> Case;

/// The kinds of cases and their weights.
const KINDS: [(&str, u32, Generator); 7] = [
    ("fields", 6, fields::case),
    ("options", 8, options::case),
    ("sizes", 2, sizes::case),
    ("special", 3, special::case),
    ("bombs", 1, bombs::case),
    ("streams", 2, streams::case),
    ("limits", 2, limits::case),
];

/// Returns the number in a variable of the environment.
fn stated(name: &str) -> Option<u64> {
    std::env::var(name).ok().map(|text| text.parse().unwrap_or_else(|_| panic!("{name}: '{text}' is no number")))
}

/// Returns the kind and the case of a number. The same seed and number always give the same case.
fn case(ground: &Ground, seed: u64, number: u64, only: Option<&str>) -> (&'static str, Case) {
    let mut rng = fastrand::Rng::with_seed(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ number);
    let kinds = KINDS.iter().filter(|(name, ..)| only.is_none_or(|only| only == *name));
    let turns: Vec<_> = kinds.flat_map(|kind| (0..kind.1).map(move |_| kind)).collect();
    let (name, _, make) = turns[number as usize % turns.len()];
    (name, make(ground, &mut rng))
}

#[test]
fn whatever_comes_the_command_ends_well() {
    let seed = stated("EYEBOX_ATTACK_SEED").unwrap_or(1);
    let first = stated("EYEBOX_ATTACK_FIRST").unwrap_or(0);
    // The limit is a number of cases and not a time, because the cases must not depend on the machine.
    let last = first + stated("EYEBOX_ATTACK_CASES").unwrap_or(400);
    let only = std::env::var("EYEBOX_ATTACK_ONLY").ok();
    let ground = Ground::new();
    let (next, begun) = (AtomicU64::new(first), Instant::now());
    let table = Mutex::new(BTreeMap::<(&str, Answer), u64>::new());
    let bad = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for worker in 0..2 {
            let (ground, next, table, bad, only) = (&ground, &next, &table, &bad, only.as_deref());
            scope.spawn(move || {
                let place = ground.place(worker);
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    if number >= last || bad.lock().unwrap().len() >= 100 {
                        break;
                    }
                    let (kind, case) = case(ground, seed, number, only);
                    let found = case.judge(&place);
                    let answer = found.as_ref().map_or(Answer::Bad, |answer| *answer);
                    *table.lock().unwrap().entry((kind, answer)).or_default() += 1;
                    if let Err(why) = found {
                        let line = format!("case {number} ({kind}): {case}\n    {why}");
                        println!("{line}");
                        bad.lock().unwrap().push(line);
                    }
                }
            });
        }
    });
    let (table, bad) = (table.into_inner().unwrap(), bad.into_inner().unwrap());
    let count: u64 = table.values().sum();
    println!("{count} cases of seed {seed} in {:.0} s", begun.elapsed().as_secs_f64());
    table.iter().for_each(|((kind, answer), count)| println!("{kind:10} {answer:12} {count:6}"));
    assert!(bad.is_empty(), "{} of {count} cases of seed {seed} ended badly:\n{}", bad.len(), bad.join("\n"));
}
