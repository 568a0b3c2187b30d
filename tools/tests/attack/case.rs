//! One run of the command, with its inputs, its supervision and the files that it may leave.

use crate::answer::{self, Answer};
use crate::ground::{self, Place};
use std::ffi::OsString;
use std::fmt;
use std::fs::{self, File};
use std::io::Read;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Address space of every case, in KiB. A case comes near this limit only if it takes too much memory.
const ADDRESSES_KIB: u64 = 2 << 20;
/// The largest memory of a case, in KiB. The planned memory of a solve adds to it.
const MEMORY_KIB: u64 = 512 << 10;
/// The time that a case may run before it receives ctrl-C.
const PATIENCE: Duration = Duration::from_millis(1500);
/// The time that a case may take to end after ctrl-C.
const TO_STOP: Duration = Duration::from_secs(5);

/// Returns the program under attack, which is `EYEBOX` or otherwise the program of this build.
pub fn program() -> String {
    std::env::var("EYEBOX").unwrap_or_else(|_| env!("CARGO_BIN_EXE_eyebox").into())
}

/// An entry that a case has in its folder when it begins.
#[derive(Clone)]
pub enum Put {
    /// A file with this content.
    Bytes(Vec<u8>),
    /// A copy of a file or folder of the ground.
    Copy(String),
    /// A pipe without a process at its other end.
    Fifo,
    /// A folder without entries.
    Folder,
    /// A link to this target.
    Link(String),
    /// A file of this length in bytes that takes no space.
    Sparse(u64),
    /// A file without permission to read.
    Locked,
    /// No entry. An existing entry is removed.
    Gone,
}

/// The other end of a standard stream.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
pub enum Stream {
    /// A pipe that the test reads to its end.
    #[default]
    Kept,
    /// No other end, because the stream is closed.
    Closed,
    /// The device `/dev/full`, which acts like a full disk.
    Full,
    /// A pipe whose reader is gone.
    Gone,
    /// A pipe whose reader never reads.
    Stuck,
}

/// One run of the command and its surroundings.
#[derive(Clone, Default)]
pub struct Case {
    /// The arguments after the program's name. Paths in `in/` belong to the case and paths in `base/` to the ground.
    /// Results go to `out/`.
    pub args: Vec<OsString>,
    /// The paths of entries in the case's folder, and the entries, in their order of creation.
    pub puts: Vec<(String, Put)>,
    /// Standard output, then standard error.
    pub streams: [Stream; 2],
    /// Limits in the form of the shell's `ulimit`.
    pub limits: Vec<String>,
    /// Variables of the command's environment.
    pub env: Vec<(&'static str, String)>,
    /// The command may notice a lack of memory by a failed allocation, and its temporary files may stay.
    pub starved: bool,
    /// Files that were complete before a failure may stay.
    pub keeps: bool,
}

impl Case {
    pub fn of(args: &[&str]) -> Self {
        Self { args: args.iter().map(OsString::from).collect(), ..Self::default() }
    }

    pub fn put(mut self, at: &str, what: Put) -> Self {
        self.puts.push((at.into(), what));
        self
    }

    /// Runs the case and returns how it ended, or the fault of its end. A case that was slow runs once more, because
    /// the machine may have been slow.
    pub fn judge(&self, place: &Place) -> Result<Answer, String> {
        self.run(place).or_else(|why| if why.contains("after ctrl-C") { self.run(place) } else { Err(why) })
    }

    fn run(&self, place: &Place) -> Result<Answer, String> {
        let at = place.path();
        place.clear();
        for (name, what) in &self.puts {
            put(&at.join(name), what, at);
        }
        let mut watched = Watched::new(self.command(at).spawn().expect("sh starts"), self.streams);
        let end = watched.wait();
        let said = watched.heard();
        let (end, said) = (end?, said.as_deref());
        let answer = answer::judge(
            end,
            watched.asked.is_some(),
            said,
            self.args.iter().any(|arg| arg == "--json"),
            self.starved,
        )?;
        if watched.peak > MEMORY_KIB && watched.peak > MEMORY_KIB + self.planned_kib(at) {
            return Err(format!("it took {} MiB", watched.peak >> 10));
        }
        let left = ground::files(&at.join("out"));
        let draft = left.iter().find(|file| file.extension().is_some_and(|end| end == "part"));
        // A run that was stopped may continue from its files. Recordings and additional outputs grow during the run.
        let grows = self.args.iter().any(|arg| arg == "record" || place.is_log(arg));
        let keeps = self.keeps || watched.asked.is_some() || grows;
        let left = if answer == Answer::Refused && !keeps { left.first() } else { draft.filter(|_| !self.starved) };
        if let Some(left) = left {
            return Err(format!("it left {}: {}", left.display(), said.unwrap_or_default()));
        }
        place.check().map_err(|what| format!("it changed {what}"))?;
        Ok(answer)
    }

    /// Returns the memory in KiB that `solve --dry-run` prints, or 0 if it prints none.
    fn planned_kib(&self, at: &Path) -> u64 {
        let values = ["--size", "--views", "--frames", "--color", "--display", "--depth-map"];
        let kept = self.args.windows(2).filter(|pair| values.iter().any(|value| pair[0] == *value)).flatten();
        // The scene follows the command's one or two words.
        let scene = self.args.get(1 + usize::from(self.args.first().is_some_and(|arg| arg == "eval")));
        let mut plan = Command::new(program());
        plan.arg("solve").args(scene).args(kept).args(["--dry-run", "--engine", "cpu", "--json"]).current_dir(at);
        let said = plan.output().expect("the command starts").stdout;
        let said: serde_json::Value = serde_json::from_slice(&said).unwrap_or_default();
        let colors = said["forecast"].as_array().into_iter().flatten();
        colors.filter_map(|color| color["peak_memory_bytes"].as_u64()).max().unwrap_or(0) >> 10
    }

    fn command(&self, at: &Path) -> Command {
        let limits = self.limits.iter().map(|l| format!("ulimit {l}; ")).collect::<String>();
        let closed: String = [(0, ">&-"), (1, "2>&-")]
            .into_iter()
            .filter(|(i, _)| self.streams[*i] == Stream::Closed)
            .map(|(_, s)| s)
            .collect::<Vec<_>>()
            .join(" ");
        // If a shell runs this test in the background, its processes ignore ctrl-C by default.
        let script = format!("ulimit -v {ADDRESSES_KIB}; {limits}exec env --default-signal=INT \"$0\" \"$@\" {closed}");
        let mut command = Command::new("sh");
        command.args(["-c", &script, &program()]).args(&self.args).current_dir(at);
        command.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").env("XDG_CACHE_HOME", at.join("cache"));
        // With one arena, the address space grows with the memory in use only.
        command
            .env("MALLOC_ARENA_MAX", "1")
            .env("RUST_BACKTRACE", "0")
            .envs(self.env.iter().map(|(k, v)| (k, v)))
            .stdin(Stdio::null());
        let [out, err] = self.streams.map(|stream| match stream {
            Stream::Full => Stdio::from(File::options().write(true).open("/dev/full").expect("a full disk")),
            Stream::Closed => Stdio::null(),
            Stream::Kept | Stream::Gone | Stream::Stuck => Stdio::piped(),
        });
        command.stdout(out).stderr(err);
        command
    }
}

impl fmt::Display for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let stream = |s| ["kept", "closed", "full", "gone", "stuck"][s as usize];
        self.limits.iter().try_for_each(|limit| write!(f, "ulimit {limit}; "))?;
        self.env.iter().try_for_each(|(name, value)| write!(f, "{name}={value} "))?;
        write!(f, "eyebox")?;
        for arg in &self.args {
            let text = arg.to_string_lossy();
            write!(f, " '{}'", text.chars().take(120).collect::<String>().escape_debug())?;
        }
        if self.streams != [Stream::Kept; 2] {
            write!(f, " [stdout {}, stderr {}]", stream(self.streams[0]), stream(self.streams[1]))?;
        }
        for (name, what) in &self.puts {
            match what {
                Put::Bytes(bytes) => write!(f, "\n    {name}: {}", shown(bytes))?,
                Put::Copy(of) => write!(f, "\n    {name}: copy of {of}")?,
                Put::Fifo => write!(f, "\n    {name}: a pipe")?,
                Put::Folder => write!(f, "\n    {name}: a folder")?,
                Put::Link(to) => write!(f, "\n    {name}: a link to {to}")?,
                Put::Sparse(bytes) => write!(f, "\n    {name}: {bytes} sparse bytes")?,
                Put::Locked => write!(f, "\n    {name}: not readable")?,
                Put::Gone => write!(f, "\n    {name}: not there")?,
            }
        }
        Ok(())
    }
}

/// Returns the beginning of a file as text.
fn shown(bytes: &[u8]) -> String {
    String::from_utf8_lossy(&bytes[..bytes.len().min(1500)]).escape_debug().to_string()
}

fn put(at: &Path, what: &Put, place: &Path) {
    fs::create_dir_all(at.parent().expect("a folder")).expect("a folder");
    if at.symlink_metadata().is_ok() {
        if at.is_dir() { fs::remove_dir_all(at) } else { fs::remove_file(at) }.expect("removed");
    }
    match what {
        Put::Bytes(bytes) => fs::write(at, bytes).expect("a file"),
        Put::Copy(of) => ground::copy(&place.join(of), at),
        Put::Fifo => assert!(Command::new("mkfifo").arg(at).status().expect("mkfifo").success()),
        Put::Folder => fs::create_dir(at).expect("a folder"),
        Put::Link(to) => std::os::unix::fs::symlink(to, at).expect("a link"),
        Put::Sparse(bytes) => File::create(at).and_then(|f| f.set_len(*bytes)).expect("a file"),
        Put::Locked => {
            fs::write(at, "locked").expect("a file");
            fs::set_permissions(at, std::os::unix::fs::PermissionsExt::from_mode(0o000)).expect("a mode");
        }
        Put::Gone => {}
    }
}

/// A run that is watched until it ends.
struct Watched {
    child: Child,
    /// Threads that read standard output and standard error.
    readers: [Option<JoinHandle<Vec<u8>>>; 2],
    /// The time of ctrl-C, if it was sent.
    asked: Option<Instant>,
    /// The peak memory of the run, in KiB.
    peak: u64,
}

impl Watched {
    fn new(mut child: Child, streams: [Stream; 2]) -> Self {
        // A dropped pipe has no reader. A pipe that stays in `child` has a reader that never reads.
        let mut readers = [None, None];
        match streams[0] {
            Stream::Kept => readers[0] = child.stdout.take().map(read),
            Stream::Gone => drop(child.stdout.take()),
            _ => {}
        }
        match streams[1] {
            Stream::Kept => readers[1] = child.stderr.take().map(read),
            Stream::Gone => drop(child.stderr.take()),
            _ => {}
        }
        Self { child, readers, asked: None, peak: 0 }
    }

    /// Returns the text of standard error, if a thread read it.
    fn heard(&mut self) -> Option<String> {
        let [_, said] = self.readers.each_mut().map(|reader| Some(reader.take()?.join().expect("read")));
        said.map(|said| String::from_utf8_lossy(&said).into_owned())
    }

    fn wait(&mut self) -> Result<ExitStatus, String> {
        let begun = Instant::now();
        loop {
            if let Some(end) = self.child.try_wait().expect("it is ours") {
                return Ok(end);
            }
            self.peak = self.peak.max(peak(self.child.id()));
            match self.asked {
                None if begun.elapsed() > PATIENCE => {
                    self.signal("INT");
                    self.asked = Some(Instant::now());
                }
                Some(asked) if asked.elapsed() > TO_STOP => {
                    let _ = self.child.kill();
                    let _ = self.child.wait();
                    return Err(format!("it ran on for {} s after ctrl-C", TO_STOP.as_secs()));
                }
                _ => {}
            }
            std::thread::sleep(Duration::from_millis(if begun.elapsed().as_millis() < 100 { 2 } else { 10 }));
        }
    }

    fn signal(&self, name: &str) {
        let _ = Command::new("kill").args([format!("-{name}"), self.child.id().to_string()]).status();
    }
}

/// Reads a pipe to its end on a thread of its own.
fn read(mut pipe: impl Read + Send + 'static) -> JoinHandle<Vec<u8>> {
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        pipe.read_to_end(&mut bytes).expect("read");
        bytes
    })
}

/// Returns the peak memory of a process, in KiB.
fn peak(id: u32) -> u64 {
    let status = fs::read(format!("/proc/{id}/status")).unwrap_or_default();
    let line = status.split(|b| *b == b'\n').find_map(|l| l.strip_prefix(b"VmHWM:"));
    let text = line.map(|l| String::from_utf8_lossy(l).trim().trim_end_matches(" kB").to_string());
    text.and_then(|t| t.parse().ok()).unwrap_or(0)
}

/// Returns an argument whose bytes need not be UTF-8.
pub fn word(bytes: &[u8]) -> OsString {
    std::ffi::OsStr::from_bytes(bytes).to_owned()
}
