//! Where the user keeps what can be made again.

use std::path::PathBuf;

/// The folder `eyebox` in `$XDG_CACHE_HOME` or `~/.cache`, on Windows in `%LOCALAPPDATA%`; nowhere without any.
pub fn cache_folder() -> Option<PathBuf> {
    Some(super::os::cache_base()?.join("eyebox"))
}
