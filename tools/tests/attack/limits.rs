//! Limits of the system on memory, the length of files, open files, processes and threads.

use crate::case::Case;
use crate::ground::Ground;
use crate::options::sound;

/// Returns a sound run with less of one resource than it may need.
pub fn case(_: &Ground, rng: &mut fastrand::Rng) -> Case {
    let mut case = Case::of(&sound(rng));
    // The program itself, its libraries and its first threads take less than 80 MiB.
    let limit = match rng.u8(..5) {
        0 => {
            (case.starved, case.keeps) = (true, true);
            format!("-v {}", rng.u32(80 << 10..300 << 10))
        }
        1 => {
            // The first of several files may be complete.
            case.keeps = true;
            format!("-f {}", rng.u32(..12))
        }
        2 => {
            // A far field in tiles keeps its committed tiles.
            case.keeps = true;
            format!("-n {}", rng.u32(8..24))
        }
        // This limit has no effect on root.
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
