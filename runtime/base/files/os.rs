//! Hides the differences between operating systems about files.

use std::io;
use std::path::{Path, PathBuf};

/// Returns the folder for data that can be made again. It is `eyebox` in `$XDG_CACHE_HOME` or `~/.cache`, on Windows in
/// `%LOCALAPPDATA%`, and otherwise in `$XDG_RUNTIME_DIR`. Other users cannot write to any of these.
pub fn cache_folder() -> Option<PathBuf> {
    let set = |name| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    let own = || if cfg!(windows) { set("LOCALAPPDATA") } else { Some(set("HOME")?.join(".cache")) };
    // The specification of these folders has relative paths ignored.
    let absolute = |name| set(name).filter(|p| p.is_absolute());
    let base = absolute("XDG_CACHE_HOME").or_else(own).or_else(|| absolute("XDG_RUNTIME_DIR"));
    base.map(|base| base.join("eyebox"))
}

/// Returns a path without links and dots.
#[cfg(not(windows))]
pub(super) fn canonical(path: &Path) -> io::Result<PathBuf> {
    path.canonicalize()
}

/// Returns a path without links and dots, and without the Windows prefix for paths in which `/` does not separate.
#[cfg(windows)]
pub(super) fn canonical(path: &Path) -> io::Result<PathBuf> {
    let marked = path.canonicalize()?;
    let text = marked.to_str().and_then(|text| text.strip_prefix(r"\\?\"));
    Ok(match text.map(|text| (text, text.strip_prefix(r"UNC\"))) {
        Some((_, Some(share))) => format!(r"\\{share}").into(),
        Some((text, None)) => text.into(),
        None => marked,
    })
}

/// Exchanges two names at once.
#[cfg(target_os = "linux")]
pub(super) fn exchange(a: &Path, b: &Path) -> io::Result<()> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    Ok(renameat_with(CWD, a, CWD, b, RenameFlags::EXCHANGE)?)
}

#[cfg(not(target_os = "linux"))]
pub(super) fn exchange(_: &Path, _: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

/// Makes names in a folder persist through a power cut. Only Unix has this.
#[cfg(unix)]
pub(super) fn sync_folder(folder: &Path) -> io::Result<()> {
    match std::fs::File::open(folder)?.sync_all() {
        // Some network file systems cannot do this, and report it.
        Err(e) if e.kind() == io::ErrorKind::InvalidInput || e.kind() == io::ErrorKind::Unsupported => Ok(()),
        other => other,
    }
}

#[cfg(not(unix))]
pub(super) fn sync_folder(_: &Path) -> io::Result<()> {
    Ok(())
}

/// Gives temporary names these permissions minus the umask, instead of permissions for the owner only.
#[cfg(unix)]
pub(super) fn permit(builder: &mut tempfile::Builder<'_, '_>, mode: u32) {
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(mode));
}

#[cfg(not(unix))]
pub(super) fn permit(_: &mut tempfile::Builder<'_, '_>, _: u32) {}

/// Returns true if a path leads to the file that is open.
#[cfg(unix)]
pub(super) fn is_same(open: &std::fs::File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let id = |there: std::fs::Metadata| (there.dev(), there.ino());
    open.metadata().is_ok_and(|open| std::fs::symlink_metadata(path).is_ok_and(|there| id(open) == id(there)))
}

#[cfg(not(unix))]
pub(super) fn is_same(_: &std::fs::File, path: &Path) -> bool {
    path.exists()
}

/// Opens a file or folder that belongs to the same user as `mine`. A link is refused.
#[cfg(unix)]
pub(super) fn open_own(path: &Path, mine: &std::fs::File) -> io::Result<std::fs::File> {
    use rustix::fs::OFlags;
    use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
    let flags = (OFlags::NOFOLLOW | OFlags::NONBLOCK).bits() as i32;
    let open = std::fs::File::options().read(true).custom_flags(flags).open(path)?;
    let own = open.metadata()?.uid() == mine.metadata()?.uid();
    if own { Ok(open) } else { Err(io::ErrorKind::PermissionDenied.into()) }
}

#[cfg(not(unix))]
pub(super) fn open_own(_: &Path, _: &std::fs::File) -> io::Result<std::fs::File> {
    Err(io::ErrorKind::Unsupported.into())
}
