//! Connects the two sides with a runtime folder, a check of the user, a greeting, and bytes that report news.

use crate::LiveError;
use crate::layout::{MAGIC, VERSION};
use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::net::{
    RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, SendAncillaryBuffer, SendAncillaryMessage, SendFlags,
};
use std::io::{ErrorKind, IoSlice, IoSliceMut, Read};
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The bytes of the message with which a display answers.
pub(crate) const GREETING: usize = 128;
const REASON: usize = 24;

fn own_uid() -> u32 {
    rustix::process::geteuid().as_raw()
}

/// Returns the folder with the sockets, which may not exist yet.
pub(crate) fn folder() -> PathBuf {
    let given = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from).filter(|path| path.is_absolute());
    given.map_or_else(|| format!("/tmp/eyebox-{}", own_uid()).into(), |path| path.join("eyebox"))
}

/// Creates the folder if it does not exist, and checks that no other user can write into it.
pub(crate) fn safe_folder(path: &Path) -> Result<(), LiveError> {
    let refused = |reason: String| LiveError::Folder { path: path.display().to_string(), reason };
    match std::fs::DirBuilder::new().mode(0o700).create(path) {
        Ok(()) => {}
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
        Err(error) => return Err(refused(error.to_string())),
    }
    let there = std::fs::symlink_metadata(path).map_err(|e| refused(e.to_string()))?;
    if !there.is_dir() {
        return Err(refused("not a folder (a link is not accepted)".into()));
    }
    if there.uid() != own_uid() {
        return Err(refused(format!("belongs to user {}, but it must belong to user {}", there.uid(), own_uid())));
    }
    if there.mode() & 0o077 != 0 {
        return Err(refused(format!("open to other users. Run chmod 700 {}.", path.display())));
    }
    Ok(())
}

/// Returns the path of the socket of a name.
pub(crate) fn path_of(folder: &Path, name: &str) -> Result<PathBuf, LiveError> {
    let right = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '_' | '-');
    if !(1..=64).contains(&name.len()) || name.starts_with('.') || !name.chars().all(right) {
        return Err(LiveError::Name(name.into()));
    }
    Ok(folder.join(format!("{name}.sock")))
}

/// Refuses the other side if it belongs to another user.
pub(crate) fn check_peer(stream: &UnixStream) -> Result<(), LiveError> {
    let who = rustix::net::sockopt::socket_peercred(stream);
    let who = who.map_err(|e| LiveError::System { what: "the user of the other side", error: e.into() })?;
    check_user(who.uid.as_raw(), own_uid())
}

fn check_user(uid: u32, own: u32) -> Result<(), LiveError> {
    if uid == own { Ok(()) } else { Err(LiveError::OtherUser { uid, own }) }
}

/// Sends a region to the application.
pub(crate) fn welcome(stream: &UnixStream, fd: &OwnedFd, bytes: u64) -> bool {
    send(stream, &greeting(0, bytes, ""), Some(fd))
}

/// Sends a refusal with its reason.
pub(crate) fn refuse(stream: &UnixStream, reason: &str) {
    send(stream, &greeting(1, 0, reason), None);
}

fn greeting(refused: u32, bytes: u64, reason: &str) -> [u8; GREETING] {
    let mut message = [0; GREETING];
    message[..8].copy_from_slice(&MAGIC.to_le_bytes());
    message[8..12].copy_from_slice(&VERSION.to_le_bytes());
    message[12..16].copy_from_slice(&refused.to_le_bytes());
    message[16..REASON].copy_from_slice(&bytes.to_le_bytes());
    let shown = reason.len().min(GREETING - REASON);
    message[REASON..REASON + shown].copy_from_slice(&reason.as_bytes()[..shown]);
    message
}

/// Sends a message and a file descriptor without waiting. Returns true if all of it was sent.
fn send(stream: &UnixStream, message: &[u8], fd: Option<&OwnedFd>) -> bool {
    let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(1))];
    let mut control = SendAncillaryBuffer::new(&mut space);
    let fds: Vec<_> = fd.into_iter().map(AsFd::as_fd).collect();
    let flags = SendFlags::NOSIGNAL | SendFlags::DONTWAIT;
    (fds.is_empty() || control.push(SendAncillaryMessage::ScmRights(&fds)))
        && rustix::net::sendmsg(stream, &[IoSlice::new(message)], &mut control, flags) == Ok(message.len())
}

/// Receives a message without waiting. Returns its length and the file descriptor that came with it.
fn receive(stream: &UnixStream, message: &mut [u8]) -> (rustix::io::Result<usize>, Option<OwnedFd>) {
    let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(1))];
    let mut control = RecvAncillaryBuffer::new(&mut space);
    let flags = RecvFlags::CMSG_CLOEXEC | RecvFlags::DONTWAIT;
    let received = rustix::net::recvmsg(stream, &mut [IoSliceMut::new(message)], &mut control, flags);
    let fd = control.drain().find_map(|part| match part {
        RecvAncillaryMessage::ScmRights(mut fds) => fds.next(),
        _ => None,
    });
    (received.map(|received| received.bytes), fd)
}

/// Receives the region's file descriptor and its length in bytes from a display that accepts this process within
/// `patience`.
pub(crate) fn greeted(stream: &UnixStream, patience: Duration) -> Result<(OwnedFd, u64), LiveError> {
    let failed = |error| LiveError::System { what: "the display's answer", error };
    if !wait(&[stream.as_fd()], patience) {
        return Err(failed(ErrorKind::TimedOut.into()));
    }
    let mut message = [0; GREETING];
    let (received, fd) = receive(stream, &mut message);
    let bytes = received.map_err(|e| failed(e.into()))?;
    let u32_at = |at: usize| u32::from_le_bytes([message[at], message[at + 1], message[at + 2], message[at + 3]]);
    if bytes != GREETING || message[..8] != MAGIC.to_le_bytes() || u32_at(8) != VERSION {
        return Err(LiveError::Damaged(format!("no greeting of live input, version {VERSION}")));
    }
    let reason = String::from_utf8_lossy(&message[REASON..]);
    match (u32_at(12), fd) {
        (0, Some(fd)) => Ok((fd, u64::from(u32_at(16)) | u64::from(u32_at(20)) << 32)),
        (0, None) => Err(LiveError::Damaged("a greeting without memory".into())),
        _ => Err(LiveError::Refused(reason.trim_end_matches('\0').escape_default().to_string())),
    }
}

/// Sends a byte that reports news, if the socket has room for it.
pub(crate) fn nudge(stream: &UnixStream) {
    let _ = rustix::net::send(stream, &[1], SendFlags::NOSIGNAL | SendFlags::DONTWAIT);
}

/// Sends a byte that reports news, with a file descriptor.
pub(crate) fn nudge_with(stream: &UnixStream, fd: &OwnedFd) -> bool {
    send(stream, &[1], Some(fd))
}

/// Reads the bytes of the other side up to a file descriptor, without waiting. Returns true if the other side is
/// connected, and the descriptor.
pub(crate) fn listen_for_fd(stream: &UnixStream) -> (bool, Option<OwnedFd>) {
    let (received, fd) = receive(stream, &mut [0; 1024]);
    let there = received.map_or_else(|e| matches!(e, rustix::io::Errno::AGAIN | rustix::io::Errno::INTR), |n| n > 0);
    (there, fd)
}

/// Reads the bytes of the other side, up to 2 KiB, without waiting. Returns true if the other side is connected.
pub(crate) fn listen(mut stream: &UnixStream) -> bool {
    // Unread bytes come before the end of the stream, so only a second read finds the end. There are no more reads,
    // because the other side may send forever.
    for _ in 0..2 {
        match stream.read(&mut [0; 1024]) {
            Ok(0) => return false,
            Ok(_) => {}
            Err(error) => return matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted),
        }
    }
    true
}

/// Waits for bytes of the other side until this moment. Returns false if the moment has passed.
pub(crate) fn wait_until(stream: &UnixStream, until: Instant) -> bool {
    let left = until.saturating_duration_since(Instant::now());
    if !left.is_zero() {
        wait(&[stream.as_fd()], left);
    }
    !left.is_zero()
}

/// Waits until one of them is readable. Returns true if one is.
pub(crate) fn wait(fds: &[BorrowedFd<'_>], patience: Duration) -> bool {
    let mut waiting: Vec<_> = fds.iter().map(|fd| PollFd::from_borrowed_fd(*fd, PollFlags::IN)).collect();
    let timeout = Timespec { tv_sec: patience.as_secs().min(1 << 40) as i64, tv_nsec: patience.subsec_nanos().into() };
    rustix::event::poll(&mut waiting, Some(&timeout)).is_ok_and(|ready| ready > 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_in_the_folder() {
        let folder = Path::new("/run/eyebox");
        assert_eq!(path_of(folder, "a.B-1_").unwrap(), Path::new("/run/eyebox/a.B-1_.sock"));
        for bad in ["", ".", "..", ".a", "a/b", "../a", "a b", "a\0", "é", &"a".repeat(65)] {
            let error = path_of(folder, bad).unwrap_err().to_string();
            assert!(error.contains("1 to 64"), "{error}");
        }
    }

    #[test]
    fn another_user_is_refused() {
        let error = check_user(1001, 1000).unwrap_err().to_string();
        assert_eq!(error, "the other side belongs to user 1001, but only user 1000 is accepted");
        check_user(1000, 1000).unwrap();
        let (one, _other) = UnixStream::pair().unwrap();
        check_peer(&one).unwrap();
    }
}
