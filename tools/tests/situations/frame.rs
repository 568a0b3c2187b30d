//! Runs the command of a situation, follows the remedy of a refusal and judges the result.

use crate::common::{Refusal, folder, text};
use crate::ground::{self, Ground};
use crate::judge::Judge;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The last words of each `render` command, unless the situation states its own pupil. The pupil is off the axis, so
/// views in another order and inverted depths give another picture. `cells` is the quick method.
pub const RENDER: &str = "--pupil=9,-4,2,0.5 --size 48x64 --photographs cells --engine cpu -o out.npy";

/// Makes files in a folder.
type Maker = Box<dyn Fn(&Path) + Send + Sync>;

/// The situations of one kind.
pub struct Chapter {
    /// The heading on the page.
    pub title: &'static str,
    /// One sentence or more below the heading.
    pub about: &'static str,
    pub situations: Vec<Situation>,
}

impl Situation {
    /// Makes the command run on this ground.
    pub fn on(self, ground: Ground) -> Self {
        Self { ground, ..self }
    }
}

/// Files of a user, a command, and its right answer.
pub struct Situation {
    /// One plain sentence about the user's files, of at most 160 characters. Each situation has its own sentence.
    pub have: String,
    /// The words of the command, without `eyebox`. Single quotes keep a space, and `\xE9` is a byte.
    pub words: String,
    files: Maker,
    pub answer: Answer,
    ground: Ground,
}

/// The right answer of a command.
pub enum Answer {
    /// The exit code is 0, and the result is right.
    Right(Judge),
    /// The exit code is 2, and the command prints one line. `cause` has the code of the error and words that the line
    /// must contain. The result is right after the remedy.
    Refused { cause: &'static str, remedy: Remedy, then: Judge },
}

/// The advice in the line of a refusal. The line must contain the options, keys, files and numbers that are given here.
#[allow(dead_code, reason = "not every form is needed at any time")]
pub enum Remedy {
    /// Words to add to the command.
    Add(&'static str),
    /// A word of the command and its replacement. Only the replacement must occur in the line.
    Replace(&'static str, &'static str),
    /// A form that the line names, a word of the command, and the replacement of the word in this form.
    As(&'static str, &'static str, &'static str),
    /// Advice for the page, a word of the command, and the word that replaces it.
    By(&'static str, &'static str, &'static str),
    /// Another command, without `eyebox`.
    Instead(&'static str),
    /// A text file in the folder, and lines to add to it, separated by `\n`. Every line must occur in the line of the
    /// refusal.
    State(&'static str, &'static str),
    /// The words of the line that name a conversion, the conversion, and the words of the command for the file and its
    /// result.
    Convert(&'static str, Maker, &'static str, &'static str),
    /// The words of the line that name a change of the files, and the change.
    Change(&'static str, Maker),
    /// Advice for the page and a change of the files.
    Mend(&'static str, Maker),
}

/// Makes a remedy that changes the files by `how`. The line must contain the words `named`.
pub fn change(named: &'static str, how: impl Fn(&Path) + Send + Sync + 'static) -> Remedy {
    Remedy::Change(named, Box::new(how))
}

/// Makes a remedy that changes the files by `how`. The page shows `prose`.
pub fn mended(prose: &'static str, how: impl Fn(&Path) + Send + Sync + 'static) -> Remedy {
    Remedy::Mend(prose, Box::new(how))
}

/// Makes a remedy that converts a file by `how`. The line must contain `named`, and `to` replaces `from` in the
/// command.
pub fn convert(
    named: &'static str,
    from: &'static str,
    to: &'static str,
    how: impl Fn(&Path) + Send + Sync + 'static,
) -> Remedy {
    Remedy::Convert(named, Box::new(how), from, to)
}

/// A situation without its answer.
pub struct Case {
    have: String,
    words: String,
    files: Maker,
}

/// Makes a case of a sentence, the words of the command, and a function that makes the files.
pub fn case(have: impl Into<String>, words: impl Into<String>, files: impl Fn(&Path) + Send + Sync + 'static) -> Case {
    Case { have: have.into(), words: words.into(), files: Box::new(files) }
}

impl Case {
    /// Adds the answer that the command succeeds with the right result.
    pub fn right(self, judge: Judge) -> Situation {
        self.with(Answer::Right(judge))
    }

    /// Adds the answer that the command refuses for this cause, and that the result is right after the remedy.
    pub fn refused(self, cause: &'static str, remedy: Remedy, then: Judge) -> Situation {
        self.with(Answer::Refused { cause, remedy, then })
    }

    fn with(self, answer: Answer) -> Situation {
        Situation { have: self.have, words: self.words, files: self.files, answer, ground: Ground::Usual }
    }
}

/// The result of a command, for its judge.
pub struct Outcome<'a> {
    /// The folder of the situation, in which the command ran.
    pub folder: &'a Path,
    pub stdout: String,
    pub stderr: String,
}

impl Chapter {
    /// Runs all situations, two at a time.
    ///
    /// # Panics
    /// Panics with a list of the situations that have a wrong answer.
    pub fn follow(&self) {
        let only = std::env::var("EYEBOX_SITUATION").unwrap_or_default();
        let asked = |s: &&Situation| s.have.contains(&only) || s.words.contains(&only);
        let situations: Vec<&Situation> = self.situations.iter().filter(asked).collect();
        let (next, bad) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
        std::thread::scope(|scope| {
            for _ in 0..2 {
                scope.spawn(|| {
                    while let Some(situation) = situations.get(next.fetch_add(1, Ordering::Relaxed)) {
                        let followed = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| situation.follow()));
                        if let Err(why) = followed.unwrap_or_else(|_| Err("the situation's own code panics".into())) {
                            bad.lock().unwrap().push(format!("{}\n  {}\n  {why}", situation.have, situation.words));
                        }
                    }
                });
            }
        });
        let bad = bad.into_inner().unwrap();
        let all = situations.len();
        assert!(bad.is_empty(), "{}: {} of {all} have a wrong answer:\n{}", self.title, bad.len(), bad.join("\n"));
    }
}

impl Situation {
    fn follow(&self) -> Result<(), String> {
        let temp = folder();
        let at = temp.path();
        let ground = match self.ground.prefix(at) {
            Ok(ground) => ground,
            Err(why) => {
                eprintln!("skipped, because {why}: {}", self.have);
                return Ok(());
            }
        };
        (self.files)(at);
        let (cause, remedy, then) = match &self.answer {
            Answer::Right(judge) => return judge.judge(&run(at, &ground, &self.words)?),
            Answer::Refused { cause, remedy, then } => (*cause, remedy, then),
        };
        let before = contents(at);
        let refusal = refusal(at, &ground, &self.words)?;
        let line = refusal.message;
        if contents(at) != before {
            return Err(format!("the refusal changed the files: {:?} from {before:?}", contents(at)));
        }
        let named = |text: &str| match line.contains(text) {
            true => Ok(()),
            false => Err(format!("the line lacks '{text}': {line}")),
        };
        let mut words = cause.split(' ');
        if words.next() != Some(&refusal.code[..]) {
            return Err(format!("it is {}, not {cause}: {line}", refusal.code));
        }
        words.try_for_each(named)?;
        let words = match remedy {
            Remedy::Add(words) => {
                named(words)?;
                format!("{} {words}", self.words)
            }
            Remedy::Replace(from, to) => {
                named(to)?;
                self.words.replace(from, to)
            }
            Remedy::By(_, from, to) => self.words.replace(from, to),
            Remedy::As(form, from, to) => {
                form.split(' ').try_for_each(named)?;
                self.words.replace(from, to)
            }
            Remedy::Instead(words) => {
                named(words)?;
                (*words).to_owned()
            }
            Remedy::State(file, lines) => {
                lines.lines().try_for_each(named)?;
                let old = fs::read_to_string(at.join(file)).unwrap_or_default();
                fs::write(at.join(file), format!("{old}{lines}\n")).map_err(|e| e.to_string())?;
                self.words.clone()
            }
            Remedy::Convert(words, how, from, to) => {
                named(words)?;
                how(at);
                self.words.replace(from, to)
            }
            Remedy::Mend(_, how) => {
                how(at);
                self.words.clone()
            }
            Remedy::Change(words, how) => {
                words.split(' ').try_for_each(named)?;
                how(at);
                self.words.clone()
            }
        };
        let after = run(at, &ground, &words).map_err(|why| format!("the remedy does not work: {why}\n  of: {line}"))?;
        then.judge(&after).map_err(|why| format!("wrong after the remedy: {why}"))
    }
}

/// Runs a command that must succeed.
fn run<'a>(at: &'a Path, ground: &[String], words: &str) -> Result<Outcome<'a>, String> {
    let answer = ground::command(at, ground, &split(&complete(words))).output().expect("the command starts");
    let [stdout, stderr] = [&answer.stdout, &answer.stderr].map(|bytes| text(bytes));
    match answer.status.code() {
        Some(0) => Ok(Outcome { folder: at, stdout, stderr }),
        code => Err(format!("exit code {code:?}: {stderr}")),
    }
}

/// Runs a command that must refuse, and returns its refusal.
fn refusal(at: &Path, ground: &[String], words: &str) -> Result<Refusal, String> {
    let mut command = ground::command(at, ground, &split(&complete(words)));
    let answer = command.env("EYEBOX_JSON_ERRORS", "1").output().expect("the command starts");
    let said = text(&answer.stderr);
    match (answer.status.code(), said.trim().lines().count()) {
        (Some(2), 1) => Ok(Refusal::of(&answer)),
        (Some(2), _) => Err(format!("not one line: {said}")),
        (code, _) => Err(format!("exit code {code:?} instead of a refusal: {said}")),
    }
}

/// Returns the words of a command. A `render` command without a pupil receives [`RENDER`].
fn complete(words: &str) -> String {
    let lacks_pupil = words.starts_with("render ") && !words.contains("--pupil");
    if lacks_pupil { format!("{words} {RENDER}") } else { words.to_owned() }
}

/// Splits words at spaces outside single quotes, as a shell does. `\xE9` becomes one byte.
fn split(words: &str) -> Vec<OsString> {
    let (mut out, mut word, mut quoted, mut begun) = (Vec::new(), Vec::new(), false, false);
    let bytes = words.as_bytes();
    let mut i = 0;
    while i < bytes.len() {
        match bytes[i] {
            b'\'' => (quoted, begun) = (!quoted, true),
            b' ' if !quoted => {
                if begun {
                    out.push(std::mem::take(&mut word));
                }
                begun = false;
            }
            b'\\' if bytes.get(i + 1) == Some(&b'x') => {
                word.push(u8::from_str_radix(&words[i + 2..i + 4], 16).expect("two hexadecimal digits"));
                (i, begun) = (i + 3, true);
            }
            byte => {
                word.push(byte);
                begun = true;
            }
        }
        i += 1;
    }
    if begun {
        out.push(word);
    }
    out.into_iter().map(word_of).collect()
}

#[cfg(unix)]
pub fn word_of(bytes: Vec<u8>) -> OsString {
    std::os::unix::ffi::OsStringExt::from_vec(bytes)
}

#[cfg(not(unix))]
pub fn word_of(bytes: Vec<u8>) -> OsString {
    String::from_utf8_lossy(&bytes).into_owned().into()
}

/// Returns every file below a folder with its length.
fn contents(folder: &Path) -> BTreeMap<std::path::PathBuf, u64> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            let kind = entry.file_type().expect("a kind");
            found.insert(entry.path(), if kind.is_file() { entry.metadata().map_or(0, |m| m.len()) } else { 0 });
            if kind.is_dir() {
                open.push(entry.path());
            }
        }
    }
    found
}
