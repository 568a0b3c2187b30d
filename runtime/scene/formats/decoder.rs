//! Decodes videos of any format by a child process of ffmpeg, as YUV4MPEG2.
//!
//! Frames leave ffmpeg deinterlaced, upright and with square pixels, as Y'CbCr of BT.709 with 16 bits and without
//! subsampling, or as gray of 16 bits. Thus the samples of any source keep their values to a fraction of a level. A video of high definition
//! without a stated matrix has the matrix of BT.709, and other videos have the matrix of BT.601, as players assume.

use crate::SceneError;
use crate::formats::video_color::is_high_definition;
use eyebox_base::error::Reason;
use eyebox_base::reason;
use std::io::{BufReader, Read};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::OnceLock;
use std::thread::JoinHandle;

/// The endings of files that ffmpeg decodes. Playlists and streams are left out, because they name other files.
const ENDINGS: [&str; 16] =
    ["mp4", "m4v", "mov", "mkv", "webm", "avi", "mpg", "mpeg", "ts", "m2ts", "mts", "wmv", "flv", "ogv", "3gp", "mxf"];

/// Returns true if a file has the name of a video, and ffmpeg is there to decode it.
pub(crate) fn decodes(path: &Path) -> bool {
    let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    ENDINGS.contains(&ending.as_str()) && is_here()
}

/// Returns true if the programs ffmpeg and ffprobe are on the path.
fn is_here() -> bool {
    static HERE: OnceLock<bool> = OnceLock::new();
    *HERE.get_or_init(|| {
        let has =
            |folder: &Path, name: &str| folder.join(name).with_extension(std::env::consts::EXE_EXTENSION).is_file();
        let path = std::env::var_os("PATH").unwrap_or_default();
        let folders: Vec<_> = std::env::split_paths(&path).collect();
        ["ffmpeg", "ffprobe"].iter().all(|name| folders.iter().any(|folder| has(folder, name)))
    })
}

/// The part of a frame that is decoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum What {
    Colors,
    /// The transparency as gray of the full range.
    Alpha,
}

/// The facts that a file states about its video.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Stated {
    pub has_alpha: bool,
    /// True for samples of more than 8 bits.
    pub is_deep: bool,
    /// True for gray samples, which have no color differences.
    pub is_gray: bool,
    /// True for samples of the full range.
    pub is_full: bool,
    /// The matrix and the range, for people.
    pub read_as: String,
    /// The decoder that is not ffmpeg's usual one, because only this one decodes transparency.
    decoder: Option<&'static str>,
    /// The filters that convert the frames.
    filters: String,
}

fn failed(path: &Path, said: &str) -> SceneError {
    let said = said.lines().rfind(|line| !line.trim().is_empty()).unwrap_or("it does not say why").trim();
    let reason = reason!("video-undecoded", "ffmpeg cannot decode it ({said})");
    SceneError::Corrupt { file: path.display().to_string(), reason }
}

/// Returns the name of the file for ffmpeg, which would read options and protocols from others.
fn named(path: &Path) -> std::ffi::OsString {
    let mut name = std::ffi::OsString::from("file:");
    name.push(path);
    name
}

impl Stated {
    /// Reads the statements of a file.
    ///
    /// # Errors
    /// [`SceneError::Corrupt`] for a file without a video, a matrix that is not converted, and light of high dynamic
    /// range.
    pub fn of(path: &Path) -> Result<Self, SceneError> {
        const ENTRIES: &str =
            "stream=codec_name,pix_fmt,width,height,color_range,color_space,color_transfer:stream_tags=alpha_mode";
        let output = Command::new("ffprobe")
            .args(["-v", "error", "-protocol_whitelist", "file,pipe", "-select_streams", "v:0"])
            .args(["-show_entries", ENTRIES, "-of", "default=noprint_wrappers=1"])
            .arg(named(path))
            .stdin(Stdio::null())
            .output()
            .map_err(|e| SceneError::unreadable(path, &e))?;
        if !output.status.success() {
            return Err(failed(path, &String::from_utf8_lossy(&output.stderr)));
        }
        let text = String::from_utf8_lossy(&output.stdout);
        Self::parse(&text).map_err(|reason| SceneError::Corrupt { file: path.display().to_string(), reason })
    }

    /// Reads the answer of ffprobe, which has a line `name=value` for each fact.
    fn parse(text: &str) -> Result<Self, Reason> {
        let value = |name: &str| {
            let of = |line: &'_ str| {
                line.split_once('=').filter(|(key, _)| *key == name).map(|(_, value)| value.trim().to_owned())
            };
            text.lines().find_map(of).filter(|v| !matches!(v.as_str(), "unknown" | "N/A" | "unspecified" | "reserved"))
        };
        let number = |name: &str| value(name).and_then(|v| v.parse::<usize>().ok()).unwrap_or(0);
        let Some(pixels) = value("pix_fmt") else {
            return Err(reason!("no-video", "it has no video"));
        };
        if let Some(transfer @ ("smpte2084" | "arib-std-b67")) = value("color_transfer").as_deref() {
            return Err(reason!(
                "video-hdr",
                "its light is of high dynamic range ({transfer}). Convert it by ffmpeg -i CLIP -vf \
                 zscale=t=linear,tonemap=hable,zscale=t=bt709:m=bt709:r=tv -pix_fmt yuv420p OUT"
            ));
        }
        let is_rgb =
            ["rgb", "bgr", "gbr", "argb", "abgr", "0rgb", "0bgr", "pal8"].iter().any(|kind| pixels.starts_with(kind));
        let is_gray = pixels.starts_with("gray") || pixels.starts_with("ya") || pixels.starts_with("mono");
        let matrix = match value("color_space").as_deref() {
            _ if is_rgb || is_gray => None,
            Some("bt709") => Some("bt709"),
            Some("smpte170m" | "bt470bg") => Some("bt601"),
            Some(other) => {
                return Err(reason!(
                    "video-matrix",
                    "its matrix is {other} instead of bt601 or bt709. Convert it by ffmpeg -i CLIP -vf \
                     scale=out_color_matrix=bt709 OUT"
                ));
            }
            None if is_high_definition([number("height"), number("width")]) => Some("bt709"),
            None => Some("bt601"),
        };
        let is_full = match value("color_range").as_deref() {
            Some("pc") => true,
            Some("tv") if !is_rgb => false,
            // Gray values without a statement have the full range, as in pictures.
            _ => is_rgb || is_gray || pixels.starts_with("yuvj"),
        };
        let alpha_mode = value("TAG:alpha_mode").or_else(|| value("alpha_mode")).is_some_and(|mode| mode == "1");
        let decoder = match value("codec_name").as_deref() {
            Some("vp8") if alpha_mode => Some("libvpx"),
            Some("vp9") if alpha_mode => Some("libvpx-vp9"),
            _ => None,
        };
        let has_alpha = alpha_mode
            || ["yuva", "ya", "rgba", "bgra", "argb", "abgr", "gbrap", "pal8"]
                .iter()
                .any(|kind| pixels.starts_with(kind));
        let digits = pixels.trim_end_matches("le").trim_end_matches("be");
        let depth = digits.rsplit(|c: char| !c.is_ascii_digit()).next().and_then(|n| n.parse::<u32>().ok());
        let is_deep = depth.is_some_and(|n| (9..=16).contains(&n) || n == 48 || n == 64) && !pixels.starts_with("nv");
        let frames = "yadif=deint=interlaced,scale=trunc(iw*sar+0.5):ih:flags=bicubic+accurate_rnd";
        // Gray values keep their range, because its conversion would have an error of 0.4 %.
        let filters = if is_gray {
            format!("{frames},setsar=1")
        } else {
            let from = matrix.map_or(String::new(), |matrix| format!(":in_color_matrix={matrix}"));
            let range = match is_full {
                _ if is_rgb => "",
                true => ":in_range=pc",
                false => ":in_range=tv",
            };
            format!("{frames}+full_chroma_int{from}{range}:out_color_matrix=bt709:out_range=tv,setsar=1")
        };
        let said =
            matrix.map_or(if is_gray { "gray" } else { "RGB" }, |m| if m == "bt709" { "BT.709" } else { "BT.601" });
        let read_as = format!("{said}, {} range, sRGB, by ffmpeg", if is_full { "full" } else { "limited" });
        Ok(Self { has_alpha, is_deep, is_gray, is_full, read_as, decoder, filters })
    }
}

/// A running ffmpeg, which is read as a file of YUV4MPEG2 from its beginning.
pub(crate) struct Decoder {
    child: Child,
    /// The process that started it. It is not ended by a fork of this process.
    owner: u32,
    from: BufReader<ChildStdout>,
    said: Option<JoinHandle<String>>,
}

/// Bytes of ffmpeg's messages that are kept.
const SAID: usize = 4096;

impl Decoder {
    /// Starts to decode the video of a file.
    pub fn start(path: &Path, stated: &Stated, what: What) -> Result<Self, SceneError> {
        let unreadable = |e: std::io::Error| SceneError::unreadable(path, &e);
        let filters = match what {
            What::Colors => stated.filters.clone(),
            What::Alpha => "alphaextract,scale=trunc(iw*sar+0.5):ih,setsar=1".into(),
        };
        let format = if what == What::Alpha || stated.is_gray { "gray16le" } else { "yuv444p16le" };
        let mut command = Command::new("ffmpeg");
        command.args(["-nostdin", "-v", "error", "-protocol_whitelist", "file,pipe"]);
        if let Some(decoder) = stated.decoder {
            command.args(["-c:v", decoder]);
        }
        command.arg("-i").arg(named(path)).args(["-map", "0:v:0", "-vf", &filters, "-pix_fmt", format]);
        command.args(["-f", "yuv4mpegpipe", "-strict", "-1", "pipe:1"]);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        #[cfg(unix)]
        {
            // An interrupt of the terminal is for the program, which ends its decoders itself.
            use std::os::unix::process::CommandExt;
            command.process_group(0);
        }
        let mut child = command.spawn().map_err(unreadable)?;
        let (Some(out), Some(mut errors)) = (child.stdout.take(), child.stderr.take()) else {
            unreachable!("both are piped")
        };
        let said = std::thread::spawn(move || {
            let (mut all, mut part) = (Vec::new(), [0; 1024]);
            while let Ok(n @ 1..) = errors.read(&mut part) {
                all.extend_from_slice(&part[..n]);
                let excess = all.len().saturating_sub(SAID);
                all.drain(..excess);
            }
            String::from_utf8_lossy(&all).into_owned()
        });
        Ok(Self { child, owner: std::process::id(), from: BufReader::with_capacity(1 << 16, out), said: Some(said) })
    }

    pub fn reader(&mut self) -> &mut BufReader<ChildStdout> {
        &mut self.from
    }

    /// Checks at the end of the frames that ffmpeg has decoded all.
    pub fn check_end(&mut self, path: &Path) -> Result<(), SceneError> {
        let status = self.child.wait().map_err(|e| SceneError::unreadable(path, &e))?;
        let said = self.said.take().and_then(|said| said.join().ok()).unwrap_or_default();
        if status.success() { Ok(()) } else { Err(failed(path, &said)) }
    }
}

impl Drop for Decoder {
    fn drop(&mut self) {
        if self.owner != std::process::id() {
            return;
        }
        // An ended child is no error.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
