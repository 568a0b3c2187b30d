//! Puts pipes, devices, folders, links and sparse files of gigabytes where regular files belong. They replace inputs,
//! files inside inputs, results and the cache.

use crate::case::{Case, Put};
use crate::ground::Ground;
use crate::options::sound;

fn odd(rng: &mut fastrand::Rng) -> Put {
    match rng.u8(..10) {
        0..=1 => Put::Fifo,
        2 => Put::Folder,
        3 => Put::Link(["/dev/zero", "/dev/null", "/dev/full", "/dev/random"][rng.usize(..4)].into()),
        4 => Put::Link("none".into()),
        // These links lead to their own folder, to the folder above or to `loop`.
        5 => Put::Link([".", "..", "loop"][rng.usize(..3)].into()),
        6 => Put::Sparse(3 << 30),
        7 => Put::Sparse(rng.u64(..1 << 22)),
        8 => Put::Bytes(Vec::new()),
        _ => [Put::Gone, Put::Locked][rng.usize(..2)].clone(),
    }
}

/// Returns a sound run in which an odd entry replaces one input or one file of it.
pub fn case(ground: &Ground, rng: &mut fastrand::Rng) -> Case {
    let run = sound(rng);
    let inputs: Vec<&str> = run.iter().filter(|arg| arg.starts_with("base/")).copied().collect();
    if inputs.is_empty() || rng.u8(..8) == 0 {
        return elsewhere(run, rng);
    }
    let input = inputs[rng.usize(..inputs.len())];
    // A display file needs the other files of its folder.
    let whole = if input.starts_with("base/bench") { "base/bench" } else { input };
    let own = whole.replacen("base/", "in/", 1);
    let args: Vec<String> =
        run.iter().map(|arg| if *arg == input { arg.replacen("base/", "in/", 1) } else { (*arg).into() }).collect();
    let case = Case::of(&args.iter().map(String::as_str).collect::<Vec<_>>()).put(&own, Put::Copy(whole.into()));
    let inside: Vec<&String> = ground.files.keys().filter(|name| name.starts_with(&format!("{whole}/"))).collect();
    if inside.is_empty() || rng.u8(..5) == 0 {
        return case.put(&own, odd(rng));
    }
    let file = inside[rng.usize(..inside.len())].replacen("base/", "in/", 1);
    // Sometimes the entry replaces the folder of the file.
    let place =
        if rng.u8(..4) == 0 { file.rsplit_once('/').map_or(file.as_str(), |(folder, _)| folder) } else { &file };
    case.put(place, odd(rng))
}

/// Returns a sound run with an odd entry at the path of its result or of the cache.
fn elsewhere(run: Vec<&str>, rng: &mut fastrand::Rng) -> Case {
    let case = Case::of(&run);
    match run.iter().map(|arg| arg.trim_start_matches("raw:")).find(|arg| arg.starts_with("out/")) {
        // The command may replace the entry like an earlier result, or refuse it. A partial result must not stay.
        Some(out) if rng.bool() => {
            // A link to a folder would be a valid output.
            let odd = match odd(rng) {
                Put::Link(to) if to.starts_with('.') => Put::Link("loop".into()),
                odd => odd,
            };
            let mut case = case.put(out, odd);
            case.keeps = true;
            case
        }
        _ => {
            let mut case = case.put(["in/cache", "in/cache/eyebox"][rng.usize(..2)], odd(rng));
            case.env.push(("XDG_CACHE_HOME", "in/cache".into()));
            case
        }
    }
}
