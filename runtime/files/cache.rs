//! Where the user keeps what can be made again.

use std::path::PathBuf;

/// `$XDG_CACHE_HOME/eyebox` or `~/.cache/eyebox`; nowhere without either.
pub fn cache_folder() -> Option<PathBuf> {
    let set = |name| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    // The specification of these folders has relative paths ignored.
    let base = set("XDG_CACHE_HOME").filter(|p| p.is_absolute()).or_else(|| Some(set("HOME")?.join(".cache")))?;
    Some(base.join("eyebox"))
}
