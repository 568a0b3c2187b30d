//! Places in which a command runs, such as a full or read-only disk, or a folder of another user. Root may write
//! everywhere, so the test mounts these disks for the command alone or runs it as another user. A machine that does not
//! allow this skips such situations.

use crate::common;
use std::ffi::OsString;
use std::path::Path;
use std::process::{Command, Stdio};

#[derive(Clone, Copy, PartialEq)]
pub enum Ground {
    /// The folder of the situation.
    Usual,
    /// The folder of the situation, in which `full` is a disk of its own with these options of `mount`.
    Disk(&'static str),
    /// The folder of the situation, on a machine without other programs, such as ffmpeg.
    Bare,
    /// The folder of the situation, for a user without more rights than the files give.
    Stranger,
}

impl Ground {
    /// Returns the words before the command. There are none if it runs as the tests do.
    ///
    /// # Errors
    /// Returns the reason if this machine has no such ground.
    pub fn prefix(self, at: &Path) -> Result<Vec<String>, String> {
        let words = |text: &[&str]| text.iter().map(|&word| word.to_owned()).collect::<Vec<_>>();
        let candidates = match self {
            Self::Usual => return Ok(Vec::new()),
            _ if !cfg!(target_os = "linux") => return Err("it needs Linux".into()),
            Self::Disk(options) => {
                std::fs::create_dir(at.join("full")).map_err(|e| e.to_string())?;
                let mount = format!("mount -t tmpfs -o {options} none full && exec \"$0\" \"$@\"");
                [&["unshare", "--mount"][..], &["unshare", "--map-root-user", "--mount"]]
                    .map(|unshare| words(&[unshare, &["sh", "-c", &mount]].concat()))
                    .to_vec()
            }
            Self::Bare => vec![words(&["env", "PATH="])],
            Self::Stranger if !is_root() => return Ok(Vec::new()),
            Self::Stranger => {
                open(at, 0o755);
                vec![words(&["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"])]
            }
        };
        let works = |prefix: &Vec<String>| {
            let tried = command(at, prefix, &["--version".into()]).stdout(Stdio::null()).stderr(Stdio::null()).status();
            tried.is_ok_and(|end| end.success())
        };
        candidates.into_iter().find(works).ok_or_else(|| "mounting or changing the user is not allowed here".into())
    }
}

fn is_root() -> bool {
    Command::new("id").arg("-u").output().is_ok_and(|answer| answer.stdout.trim_ascii() == b"0")
}

/// Returns the command in `at`, after the words of a ground.
pub fn command(at: &Path, ground: &[String], words: &[OsString]) -> Command {
    let mut own = common::command(at, &[]);
    let Some((first, rest)) = ground.split_first() else {
        own.args(words);
        return own;
    };
    let mut command = Command::new(first);
    command.args(rest).arg(own.get_program()).args(words).current_dir(at);
    command.envs(own.get_envs().filter_map(|(name, value)| Some((name, value?))));
    command
}

/// Sets the rights of a file or folder.
#[cfg(unix)]
pub fn open(path: &Path, mode: u32) {
    use std::os::unix::fs::PermissionsExt;
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).expect("its rights");
}

#[cfg(not(unix))]
pub fn open(_: &Path, _: u32) {}
