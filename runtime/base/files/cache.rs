//! Where the user keeps what can be made again.

use std::path::PathBuf;

/// The folder `eyebox` in `$XDG_CACHE_HOME` or `~/.cache`, on Windows in `%LOCALAPPDATA%`; without any, in
/// `$XDG_RUNTIME_DIR`; nowhere without that.
pub fn cache_folder() -> Option<PathBuf> {
    Some(super::os::cache_base()?.join("eyebox"))
}
