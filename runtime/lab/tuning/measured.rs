//! Stores the measured settings of this device in the user's cache, for later solves.
//!
//! The file is a convenience. A file that is damaged, of another version or of another device is not used, and the
//! error states the reason in one line.

use super::{Quality, Recommended, Trial};
use eyebox::low_level::error::Reason;
use eyebox::low_level::files::{FileError, write_file};
use eyebox::low_level::optics::Color;
use eyebox::low_level::reason;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The first words of the file. A checksum of the rest follows on the same line.
const HEAD: &str = "eyebox tradeoff 1 ";
/// The largest file size in bytes. A larger file is not from eyebox.
const LARGEST: u64 = 8 << 20;

/// The reasons for which a file of measured settings is not used.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum MeasuredError {
    /// The file could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The file has other content.
    #[error("{file}: {reason}. Run `eyebox eval tune` again to replace it.")]
    Content {
        /// The path of the file.
        file: String,
        /// The problem with the content.
        reason: Reason,
    },
}

/// The result of `eval tune` on one device.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// The description of the engine, from [`describe`](eyebox::low_level::engine::Engine::describe).
    pub device: String,
    /// The name of the scene.
    pub scene: String,
    /// The color of the scene that was tuned.
    pub color: Color,
    /// Rows and columns of the SLM.
    pub size: [usize; 2],
    /// The number of shown sub-frames.
    pub frames: usize,
    /// Fast, balanced and accurate, in this order.
    pub recommended: Vec<Recommended>,
    /// The trials that no other trial beats, by rising time.
    pub front: Vec<Trial>,
}

impl Measured {
    /// Returns the path of the device's file in a folder of caches.
    pub fn file(folder: &Path, device: &str) -> PathBuf {
        let plain = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' };
        let words: String = device.chars().map(plain).collect();
        let words: Vec<&str> = words.split('-').filter(|w| !w.is_empty()).collect();
        let name: String = words.join("-").chars().take(60).collect();
        folder.join(format!("tradeoff-{name}-{:08x}.json", crc32c::crc32c(device.as_bytes())))
    }

    /// Loads the measurements of this device. Returns `None` if there are none.
    ///
    /// # Errors
    /// Returns [`MeasuredError`] if the file cannot be used. Callers continue without it.
    pub fn load(folder: &Path, device: &str) -> Result<Option<Self>, MeasuredError> {
        let path = Self::file(folder, device);
        let wrong = |reason| MeasuredError::Content { file: path.display().to_string(), reason };
        let size = match std::fs::metadata(&path) {
            Ok(there) => there.len(),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(FileError::read(&path, e).into()),
        };
        if size > LARGEST {
            return Err(wrong(reason!("length", "too large for measured settings")));
        }
        let bytes = eyebox::low_level::files::read::bytes(&path, LARGEST).map_err(|e| FileError::read(&path, e))?;
        let text = std::str::from_utf8(&bytes).map_err(|_| wrong(reason!("no-text", "not a text file")))?;
        let (head, body) = text.split_once('\n').ok_or_else(|| wrong(reason!("cut-off", "the file is cut off")))?;
        let sum = head
            .strip_prefix(HEAD)
            .ok_or_else(|| wrong(reason!("version", "no settings of this version of eyebox")))?;
        if sum != format!("{:08x}", crc32c::crc32c(body.as_bytes())) {
            return Err(wrong(reason!("checksum", "the file is damaged")));
        }
        let found: Self =
            serde_json::from_str(body).map_err(|e| wrong(reason!("content", "not measured settings ({e})")))?;
        if found.device != device {
            return Err(wrong(reason!("another-device", "settings of another device")));
        }
        if !found.is_sound() {
            return Err(wrong(reason!("settings", "the settings are invalid")));
        }
        Ok(Some(found))
    }

    /// Saves the measurements atomically and returns the path of the file.
    ///
    /// # Errors
    /// Returns [`MeasuredError::File`] if the file cannot be written.
    pub fn save(&self, folder: &Path) -> Result<PathBuf, MeasuredError> {
        std::fs::create_dir_all(folder).map_err(|e| FileError::write(folder, e))?;
        let path = Self::file(folder, &self.device);
        let body = serde_json::to_string_pretty(self).expect("plain data");
        let head = format!("{HEAD}{:08x}\n", crc32c::crc32c(body.as_bytes()));
        write_file(&path, |out| out.write_all(head.as_bytes()).and_then(|()| out.write_all(body.as_bytes())))?;
        Ok(path)
    }

    fn is_sound(&self) -> bool {
        let named = |q| self.recommended.iter().filter(|r| r.quality == q).count() == 1;
        Quality::ALL.into_iter().all(named)
            && self.recommended.iter().all(|r| r.trial.is_sound())
            && !self.front.is_empty()
            && self.front.iter().all(Trial::is_sound)
            && self.size.iter().all(|n| (1..=65536).contains(n))
            && (1..=4096).contains(&self.frames)
    }

    /// Returns the trial that is recommended for this quality.
    pub fn of(&self, quality: Quality) -> &Trial {
        let found = self.recommended.iter().find(|r| r.quality == quality);
        &found.expect("a sound file has all three").trial
    }

    /// Returns the time of a solve of this size relative to the measured size. It scales with pixels x log2(pixels), as
    /// transforms do, and with sub-frames.
    pub fn scale(&self, [height, width]: [usize; 2], frames: usize) -> f64 {
        let work = |[h, w]: [usize; 2], frames: usize| {
            let pixels = h as f64 * w as f64;
            pixels * pixels.log2().max(1.0) * frames as f64
        };
        work([height, width], frames) / work(self.size, self.frames)
    }
}

#[cfg(test)]
mod tests {
    use super::super::front::tests::trial;
    use super::super::{front, recommend};
    use super::*;
    use eyebox::low_level::error::ErrorData;

    fn measured() -> Measured {
        let trials = [trial(3, 1.0, 20.25), trial(20, 10.0, 28.5), trial(200, 100.0, 28.75)];
        Measured {
            device: "CPU, 2 threads, AVX2".into(),
            scene: "still-life".into(),
            color: Color::Green,
            size: [256, 256],
            frames: 8,
            recommended: recommend(&trials).unwrap().to_vec(),
            front: front(&trials, |t| t.milliseconds, |t| t.mean).into_iter().cloned().collect(),
        }
    }

    #[test]
    fn comes_back_as_it_was() {
        let here = tempfile::tempdir().unwrap();
        let folder = here.path().join("deeper");
        assert!(Measured::load(&folder, &measured().device).unwrap().is_none());
        let file = measured().save(&folder).unwrap();
        assert_eq!(Measured::load(&folder, &measured().device).unwrap(), Some(measured()));
        assert!(Measured::load(&folder, "another").unwrap().is_none());
        // This is another device's file under this device's name.
        std::fs::rename(&file, Measured::file(&folder, "another")).unwrap();
        assert_eq!(ErrorData::of(&Measured::load(&folder, "another").unwrap_err()).code, "content/another-device");
        assert_eq!(measured().of(Quality::Accurate).mean, 28.75);
    }

    #[test]
    fn damage_of_any_byte_is_noticed() {
        let here = tempfile::tempdir().unwrap();
        let file = measured().save(here.path()).unwrap();
        let whole = std::fs::read(&file).unwrap();
        for at in (0..100).chain((100..whole.len()).step_by(13)) {
            let mut bytes = whole.clone();
            bytes[at] ^= 1;
            std::fs::write(&file, &bytes).unwrap();
            assert!(Measured::load(here.path(), &measured().device).is_err(), "byte {at}");
            std::fs::write(&file, &whole[..at]).unwrap();
            assert!(Measured::load(here.path(), &measured().device).is_err(), "cut at {at}");
        }
    }

    #[test]
    fn settings_that_cannot_be_are_refused_though_the_file_is_whole() {
        let here = tempfile::tempdir().unwrap();
        let refused = |change: &dyn Fn(&mut Measured)| {
            let mut all = measured();
            change(&mut all);
            all.save(here.path()).unwrap();
            Measured::load(here.path(), &measured().device).is_err()
        };
        assert!(!refused(&|_| ()));
        assert!(refused(&|m| m.recommended[0].trial.recipe.steps = usize::MAX / 2));
        assert!(refused(&|m| m.recommended[0].trial.recipe.pixel = 0));
        assert!(refused(&|m| m.front[0].milliseconds = 0.0));
        assert!(refused(&|m| m.recommended.truncate(2)));
        assert!(refused(&|m| m.front.clear()));
        assert!(refused(&|m| m.size = [0, 5]));
    }

    #[test]
    fn cost_follows_pixels_and_sub_frames() {
        let m = measured();
        assert_eq!(m.scale([256, 256], 8), 1.0);
        assert_eq!(m.scale([256, 256], 4), 0.5);
        assert!((m.scale([512, 512], 8) - 4.0 * 18.0 / 16.0).abs() < 1e-12);
        assert!(m.scale([1, 1], 1) > 0.0);
    }
}
