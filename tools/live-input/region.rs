//! Maps memory that two processes share, as words of 8 bytes.
//!
//! The other side may write at any time, so all accesses are atomic. An ordinary read of memory that changes has no
//! defined result. The file that an offscreen display shares (runtime/present/sink.rs) does not use this code, because
//! any process may shrink it. The system writes that file, and it is never mapped.

use crate::LiveError;
use memmap2::MmapRaw;
use rustix::fs::{FallocateFlags, MemfdFlags, SealFlags};
use std::os::fd::OwnedFd;
use std::sync::atomic::{AtomicU64, Ordering};

/// The seals that fix a region's length.
const FIXED: SealFlags = SealFlags::SHRINK.union(SealFlags::GROW);

/// A mapped region, zero at first.
#[derive(Debug)]
pub(crate) struct Region {
    map: MmapRaw,
    fd: OwnedFd,
}

fn failed(what: &'static str) -> impl Fn(rustix::io::Errno) -> LiveError {
    move |error| LiveError::System { what, error: error.into() }
}

impl Region {
    /// Makes a sealed region of this number of bytes, a multiple of 8, with all of its pages allocated.
    pub fn new(bytes: u64) -> Result<Self, LiveError> {
        let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
        let fd = rustix::fs::memfd_create("eyebox-live", flags).map_err(failed("memory to share"))?;
        // Pages that are allocated later may find no memory, and the process then receives a signal.
        rustix::fs::fallocate(&fd, FallocateFlags::empty(), 0, bytes).map_err(failed("memory to share"))?;
        rustix::fs::fcntl_add_seals(&fd, FIXED | SealFlags::SEAL).map_err(failed("sealing memory to share"))?;
        Self::map(fd)
    }

    /// Maps a region that the other side made, if it is sealed and has this length.
    pub fn received(fd: OwnedFd, bytes: u64) -> Result<Self, LiveError> {
        let damaged = |reason: String| LiveError::Damaged(reason);
        let seals =
            rustix::fs::fcntl_get_seals(&fd).map_err(|e| damaged(format!("the shared memory has no seals ({e})")))?;
        if !seals.contains(FIXED) {
            return Err(damaged("the shared memory is not sealed, so it could shrink while it is mapped".into()));
        }
        let length = rustix::fs::fstat(&fd).map_err(failed("the length of shared memory"))?.st_size;
        if u64::try_from(length) != Ok(bytes) || !bytes.is_multiple_of(8) {
            return Err(damaged(format!("it announces {bytes} bytes and shares {length}")));
        }
        Self::map(fd)
    }

    fn map(fd: OwnedFd) -> Result<Self, LiveError> {
        let map = MmapRaw::map_raw(&fd).map_err(|error| LiveError::System { what: "mapping shared memory", error })?;
        Ok(Self { map, fd })
    }

    /// Returns the descriptor for the other side.
    pub fn fd(&self) -> &OwnedFd {
        &self.fd
    }

    #[allow(unsafe_code, reason = "the one edge between mapped memory and everything else")]
    fn words(&self) -> &[AtomicU64] {
        // SAFETY: the mapping lives as long as `self`, can be read and written, begins at a page and has this length.
        // No process can shrink it, because it is sealed. Zeros and all other values are valid, and only atomics access
        // it in this process.
        unsafe { std::slice::from_raw_parts(self.map.as_mut_ptr().cast_const().cast(), self.map.len() / 8) }
    }

    /// Returns one word of the region.
    pub fn word(&self, at: usize) -> &AtomicU64 {
        &self.words()[at]
    }

    /// Copies words out of the region.
    pub fn load<const N: usize>(&self, at: usize) -> [u64; N] {
        let words = &self.words()[at..];
        std::array::from_fn(|i| words[i].load(Ordering::Relaxed))
    }

    /// Copies words into the region.
    pub fn store(&self, at: usize, from: &[u64]) {
        for (to, from) in self.words()[at..].iter().zip(from) {
            to.store(*from, Ordering::Relaxed);
        }
    }

    /// Copies bytes out of the region, from the beginning of a word.
    pub fn load_bytes(&self, at: usize, into: &mut [u8]) {
        let (whole, rest) = into.as_chunks_mut::<8>();
        let words = &self.words()[at..];
        for (to, from) in whole.iter_mut().zip(words) {
            *to = from.load(Ordering::Relaxed).to_le_bytes();
        }
        if !rest.is_empty() {
            rest.copy_from_slice(&words[whole.len()].load(Ordering::Relaxed).to_le_bytes()[..rest.len()]);
        }
    }

    /// Copies bytes into the region, from the beginning of a word. The last word is filled with zeros.
    pub fn store_bytes(&self, at: usize, from: &[u8]) {
        let (whole, rest) = from.as_chunks::<8>();
        let words = &self.words()[at..];
        for (to, from) in words.iter().zip(whole) {
            to.store(u64::from_le_bytes(*from), Ordering::Relaxed);
        }
        if !rest.is_empty() {
            let mut last = [0; 8];
            last[..rest.len()].copy_from_slice(rest);
            words[whole.len()].store(u64::from_le_bytes(last), Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_cuts_or_lengthens_a_region() {
        let region = Region::new(8192).unwrap();
        for bytes in [0, 4096, 8191, 8193, 1 << 31] {
            rustix::fs::ftruncate(region.fd(), bytes).unwrap_err();
        }
        region.store_bytes(1, &[1, 2, 3, 4, 5, 6, 7, 8, 9]);
        let mut back = [0; 9];
        region.load_bytes(1, &mut back);
        assert_eq!((back, region.word(2).load(Ordering::Relaxed)), ([1, 2, 3, 4, 5, 6, 7, 8, 9], 9));
        // A hole reads as zeros.
        let hole = FallocateFlags::PUNCH_HOLE | FallocateFlags::KEEP_SIZE;
        rustix::fs::fallocate(region.fd(), hole, 0, 8192).unwrap();
        region.load_bytes(1, &mut back);
        assert_eq!(back, [0; 9]);
    }

    #[test]
    fn memory_that_could_be_cut_is_not_mapped() {
        let fd = rustix::fs::memfd_create("loose", MemfdFlags::ALLOW_SEALING).unwrap();
        rustix::fs::ftruncate(&fd, 4096).unwrap();
        let error = Region::received(fd, 4096).unwrap_err().to_string();
        assert!(error.contains("not sealed"), "{error}");
        let other = Region::new(4096).unwrap().fd().try_clone().unwrap();
        let error = Region::received(other, 8192).unwrap_err().to_string();
        assert!(error.contains("announces 8192 bytes and shares 4096"), "{error}");
    }
}
