//! Makes the threads that compute, one pool for the process.

use rayon::ThreadPoolBuilder;

/// More threads than any machine has cores. A larger request is a mistake that would take minutes to start.
const MOST: usize = 512;
/// More threads than this per core only obstruct each other.
const A_CORE: usize = 16;

/// Returns the usual number of threads and the requested number, from `RAYON_NUM_THREADS` or the cores. The first is
/// limited.
fn usual() -> (usize, usize) {
    let stated = std::env::var("RAYON_NUM_THREADS").ok().and_then(|text| text.parse::<usize>().ok());
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let wanted = stated.filter(|n| *n > 0).unwrap_or(cores);
    (wanted.min(MOST).min(A_CORE * cores), wanted)
}

/// Makes a pool of `threads` threads, or of the usual number for 0. It has fewer threads if the system provides no
/// more.
pub fn pool(threads: usize) -> Result<rayon::ThreadPool, rayon::ThreadPoolBuildError> {
    let mut count = if threads > 0 { threads } else { usual().0 };
    loop {
        match ThreadPoolBuilder::new().num_threads(count).build() {
            Err(_) if count > 1 => count /= 2,
            made => return made,
        }
    }
}

/// Makes the global pool, with the number of threads in `RAYON_NUM_THREADS` or one per core. If the system provides
/// fewer threads, the pool has fewer, with a warning. Call it first in a program, because an existing pool stays.
pub fn prepare_threads() {
    let (mut count, wanted) = usual();
    if count < wanted {
        tracing::warn!("{wanted} threads are too many, so {count} are used");
    }
    // A global pool that failed cannot be made again, so the threads are tested before.
    while count > 1 && !has_threads(count) {
        count /= 2;
        tracing::warn!("the system does not provide enough threads, so {count} are tried");
    }
    // A single thread needs none of the system, because it is the current thread.
    let alone = count == 1 && !has_threads(1);
    // A pool from an earlier computation stays.
    let pool = ThreadPoolBuilder::new().num_threads(count);
    let _ = if alone { pool.use_current_thread().build_global() } else { pool.build_global() };
}

/// Returns true if the system provides this number of threads at once.
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
