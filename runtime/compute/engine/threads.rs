//! The threads that compute: one pool for the process.

use rayon::ThreadPoolBuilder;

/// More threads than any machine's cores; more asked for is a mistake that would take minutes to start.
const MOST: usize = 512;
/// More than this for each core only stand in each other's way.
const A_CORE: usize = 16;

/// As many threads as `RAYON_NUM_THREADS` says or there are cores, within reason; and how many were asked for.
fn usual() -> (usize, usize) {
    let stated = std::env::var("RAYON_NUM_THREADS").ok().and_then(|text| text.parse::<usize>().ok());
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let wanted = stated.filter(|n| *n > 0).unwrap_or(cores);
    (wanted.min(MOST).min(A_CORE * cores), wanted)
}

/// A pool of so many threads, 0 for the usual number; of fewer where the system does not give so many.
pub fn pool(threads: usize) -> Result<rayon::ThreadPool, rayon::ThreadPoolBuildError> {
    let mut count = if threads > 0 { threads } else { usual().0 };
    loop {
        match ThreadPoolBuilder::new().num_threads(count).build() {
            Err(_) if count > 1 => count /= 2,
            made => return made,
        }
    }
}

/// Makes the pool, of as many threads as `RAYON_NUM_THREADS` says or there are cores; where the system does not give so many,
/// of fewer, with a warning. Programs may call it first thing; what was made before stays.
pub fn prepare_threads() {
    let (mut count, wanted) = usual();
    if count < wanted {
        tracing::warn!("{wanted} threads were asked for: {count} are made");
    }
    // A pool of the process that could not be made cannot be made again: whether there are threads is found out before.
    while count > 1 && !has_threads(count) {
        count /= 2;
        tracing::warn!("the system does not give so many threads: {count} are tried");
    }
    // One needs none of the system: it is this thread then.
    let alone = count == 1 && !has_threads(1);
    // Made before, by whoever computed something, it stays.
    let pool = ThreadPoolBuilder::new().num_threads(count);
    let _ = if alone { pool.use_current_thread().build_global() } else { pool.build_global() };
}

/// Whether the system gives so many threads at once.
fn has_threads(count: usize) -> bool {
    let (go, wait) = std::sync::mpsc::channel::<()>();
    let wait = std::sync::Arc::new(std::sync::Mutex::new(wait));
    let spawn = |_| {
        let wait = std::sync::Arc::clone(&wait);
        std::thread::Builder::new().spawn(move || drop(wait.lock().map(|wait| wait.recv())))
    };
    let made: Vec<_> = (0..count).map(spawn).take_while(Result::is_ok).flatten().collect();
    drop(go);
    let all = made.len() == count;
    made.into_iter().for_each(|thread| drop(thread.join()));
    all
}
