//! What this machine's engines take per unit of work: measured once, kept in the user's cache folder.

use crate::Failure;
use eyebox::engine::Engine;
use eyebox::files;
use eyebox::plan::Storage;
use eyebox::solve::Rates;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::path::PathBuf;

#[derive(Serialize, Deserialize)]
struct Kept {
    engine: String,
    version: String,
    rates: Rates,
}

/// Files larger than this are not ours.
const LARGEST: u64 = 1 << 20;

/// The rates of `engine`: those kept, or measured now; `again` measures in any case.
///
/// A convenience: a file that cannot be read, is damaged or is another engine's is replaced, and where none can be
/// written, the next plan measures again.
pub fn of(engine: &mut dyn Engine, storage: Storage, again: bool, quiet: bool) -> Result<Rates, Failure> {
    let name = format!("{}, {}", engine.describe(), storage.name());
    let file = file(&name);
    if let Some(rates) = file.as_ref().filter(|_| !again).and_then(|f| kept(f, &name)) {
        return Ok(rates);
    }
    if !quiet {
        eprintln!("timing {name}: a few seconds, once");
    }
    let rates = Rates::measure(engine, storage)?;
    let kept = Kept { engine: name, version: env!("CARGO_PKG_VERSION").into(), rates };
    if let Some(file) = file {
        let _ = file.parent().map(std::fs::create_dir_all);
        let _ = files::write_file(&file, |out| Ok(serde_json::to_writer(out, &kept)?));
    }
    Ok(kept.rates)
}

fn file(engine: &str) -> Option<PathBuf> {
    let hash = Sha256::digest(engine.as_bytes());
    let short: String = hash.iter().take(8).map(|b| format!("{b:02x}")).collect();
    Some(files::cache_folder()?.join(format!("rates-{short}.json")))
}

fn kept(file: &PathBuf, engine: &str) -> Option<Rates> {
    if std::fs::metadata(file).ok()?.len() > LARGEST {
        return None;
    }
    let kept: Kept = serde_json::from_slice(&std::fs::read(file).ok()?).ok()?;
    let ours = kept.engine == engine && kept.version == env!("CARGO_PKG_VERSION") && kept.rates.is_sound();
    ours.then_some(kept.rates)
}
