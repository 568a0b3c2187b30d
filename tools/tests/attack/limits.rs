//! Limits that the system sets: memory, the length of files, open files, processes, threads.

use crate::case::Case;
use crate::ground::Ground;
use crate::options::sound;

/// A sound run within less than it may need.
pub fn case(_: &Ground, rng: &mut fastrand::Rng) -> Case {
    let mut case = Case::of(&sound(rng));
    // The program itself, its libraries and first threads take less than 80 MiB.
    let limit = match rng.u8(..5) {
        0 => {
            (case.starved, case.keeps) = (true, true);
            format!("-v {}", rng.u32(80 << 10..300 << 10))
        }
        1 => {
            // Of several files the first ones may have been written.
            case.keeps = true;
            format!("-f {}", rng.u32(..12))
        }
        2 => {
            // A far field in tiles keeps what it had committed.
            case.keeps = true;
            format!("-n {}", rng.u32(8..24))
        }
        // Root has none.
        3 => format!("-u {}", rng.u32(1..40)),
        _ => "-c 0".into(),
    };
    if limit == "-c 0" {
        let counts = ["0", "1", "3", "64", "600", "100000", "18446744073709551616", "-1", "x", ""];
        case.env.push(("RAYON_NUM_THREADS", counts[rng.usize(..counts.len())].into()));
    }
    case.limits.push(limit);
    case
}
