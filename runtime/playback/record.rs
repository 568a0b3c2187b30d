//! Keeping what was shown: a picture of every video frame of every new set, and a line for every video frame.

use super::{Moment, PlaybackError};
use crate::files::{FileError, encode_grey8, encode_rgb8, write_file};
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// A folder with `shown.csv` and `set-INDEX-VIDEOFRAME.png`. Pictures take longer than a video frame lasts, so it goes
/// with a simulated clock.
pub struct Recorder {
    folder: PathBuf,
    list: BufWriter<File>,
    size: [usize; 3],
}

impl Recorder {
    /// Makes the folder, which must be new or empty, for pictures of (rows, columns, channels).
    ///
    /// # Errors
    /// [`FileError::Taken`] where it holds something; [`FileError::Write`], [`FileError::Full`].
    pub fn new(folder: &Path, size: [usize; 3]) -> Result<Self, FileError> {
        fs::create_dir_all(folder).map_err(|e| FileError::write(folder, e))?;
        let mut entries = fs::read_dir(folder).map_err(|e| FileError::read(folder, e))?;
        if entries.next().is_some() {
            let reason = "holds something: recordings go to a new or an empty folder".into();
            return Err(FileError::Taken { path: folder.display().to_string(), reason });
        }
        let file = folder.join("shown.csv");
        let mut list = BufWriter::new(File::create(&file).map_err(|e| FileError::write(&file, e))?);
        writeln!(list, "video_frame,display_time_ns,set,video_frame_of_set,new,late_because,picture")
            .map_err(|e| FileError::write(&file, e))?;
        Ok(Self { folder: folder.to_path_buf(), list, size })
    }

    /// The name of a picture: of the idle one, or of a frame of the file.
    pub fn picture_name(index: Option<u64>, video_frame: u64) -> String {
        match index {
            Some(index) => format!("set-{index:06}-{video_frame:02}.png"),
            None => format!("idle-{video_frame:02}.png"),
        }
    }

    /// Keeps one video frame.
    ///
    /// # Errors
    /// [`PlaybackError::File`].
    pub fn add(&mut self, moment: &Moment<'_>) -> Result<(), PlaybackError> {
        let name = Self::picture_name(moment.index, moment.video_frame);
        let picture = self.folder.join(&name);
        let set = moment.index.map(|i| i.to_string()).unwrap_or_default();
        let late = moment.late.map_or("", super::Cause::name);
        let Moment { vblank, predicted_display_time_ns: time, video_frame, new, .. } = *moment;
        writeln!(self.list, "{vblank},{time},{set},{video_frame},{},{late},{name}", u8::from(new))
            .map_err(|e| FileError::write(&self.folder.join("shown.csv"), e))?;
        if !picture.exists() {
            let [height, width, channels] = self.size;
            write_file(&picture, |out| match channels {
                1 => encode_grey8(out, height, width, moment.picture),
                _ => encode_rgb8(out, height, width, moment.picture),
            })?;
        }
        Ok(())
    }

    /// Brings the list to the disk.
    ///
    /// # Errors
    /// [`PlaybackError::File`].
    pub fn finish(mut self) -> Result<(), PlaybackError> {
        let file = self.folder.join("shown.csv");
        self.list.flush().and_then(|()| self.list.get_ref().sync_all()).map_err(|e| FileError::write(&file, e))?;
        Ok(())
    }
}
