//! Decides if an output in automatic mode sends all levels, or 16 to 235 only.
//!
//! The drivers of Linux, by their automatic setting, send the limited range to HDMI and DisplayPort sinks. This holds in
//! all modes of the standard CTA-861 but 640 x 480 (`drm_default_rgb_quant_range`). DVI sinks receive the full range.

/// The timing of a mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Timing {
    /// Rows and columns that are lit.
    pub(super) size: [usize; 2],
    /// Rows and columns with the blanking.
    pub(super) total: [usize; 2],
}

/// Sizes with their totals in CTA-861, in rows and columns. 640 x 480 is left out, because its range is full.
const MODES: [([usize; 2], &[[usize; 2]]); 9] = [
    ([480, 720], &[[525, 858]]),
    ([576, 720], &[[625, 864]]),
    ([720, 1280], &[[750, 1650], [750, 1980], [750, 3300], [750, 3960]]),
    ([720, 1680], &[[750, 2200], [750, 2640], [750, 3300], [750, 3168], [825, 2000]]),
    ([1080, 1920], &[[1125, 2200], [1125, 2640], [1125, 2750]]),
    ([1080, 2560], &[[1100, 3000], [1125, 3300], [1250, 2750], [1100, 3750]]),
    ([2160, 3840], &[[2250, 4400], [2250, 5280], [2250, 5500]]),
    ([2160, 4096], &[[2250, 4400], [2250, 5280], [2250, 5500]]),
    ([4320, 7680], &[[4400, 9000], [4400, 10800], [4500, 11000]]),
];

impl Timing {
    /// True for modes of CTA-861 whose automatic range is limited.
    pub(super) fn is_limited_by_default(&self) -> bool {
        MODES.iter().any(|(size, totals)| *size == self.size && totals.contains(&self.total))
    }
}

/// True if an EDID describes a DVI sink, which is digital and lacks the HDMI block of CTA-861. Without an EDID, it is
/// `None`.
pub(super) fn is_dvi(edid: &[u8]) -> Option<bool> {
    let first = edid.get(..128).filter(|e| e.starts_with(&[0, 255, 255, 255, 255, 255, 255, 0]))?;
    let is_display_port = first[20] & 0x0f == 5;
    let hdmi = edid[128..].chunks_exact(128).any(has_hdmi_block);
    Some(!is_display_port && !hdmi)
}

/// Finds the vendor block of HDMI (0x000C03) or of its forum (0xC45DD8) in an extension of an EDID.
fn has_hdmi_block(extension: &[u8]) -> bool {
    let end = usize::from(extension[2]).min(127);
    if extension[0] != 2 {
        return false;
    }
    let mut at = 4;
    while at < end {
        let (kind, length) = (extension[at] >> 5, usize::from(extension[at] & 0x1f));
        let number = extension.get(at + 1..at + 4).filter(|_| length >= 3);
        if kind == 3 && matches!(number, Some([0x03, 0x0C, 0x00] | [0xD8, 0x5D, 0xC4])) {
            return true;
        }
        at += 1 + length;
    }
    false
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// An EDID with or without the block of HDMI.
    pub(in super::super) fn edid(hdmi: bool) -> Vec<u8> {
        let mut edid = vec![0; 256];
        edid[..8].copy_from_slice(&[0, 255, 255, 255, 255, 255, 255, 0]);
        edid[20] = 0x80;
        edid[128..132].copy_from_slice(&[2, 3, 12, 0]);
        edid[132..135].copy_from_slice(&[0x42, 0x90, 0x04]);
        edid[135..139].copy_from_slice(&[0x65, 0x03, 0x0C, if hdmi { 0 } else { 9 }]);
        edid
    }

    #[test]
    fn modes_and_sinks_decide_about_the_range() {
        let timing = |size, total| Timing { size, total };
        assert!(timing([1080, 1920], [1125, 2200]).is_limited_by_default());
        assert!(timing([720, 1280], [750, 1650]).is_limited_by_default());
        assert!(!timing([1080, 1920], [1111, 2080]).is_limited_by_default(), "reduced blanking is not in CTA-861");
        assert!(!timing([480, 640], [525, 800]).is_limited_by_default());
        assert!(!timing([1200, 1920], [1235, 2080]).is_limited_by_default());
        assert_eq!((is_dvi(&edid(true)), is_dvi(&edid(false)), is_dvi(&[])), (Some(false), Some(true), None));
        let mut display_port = edid(false);
        display_port[20] = 0xa5;
        assert_eq!(is_dvi(&display_port), Some(false));
    }

    proptest! {
        #[test]
        fn any_edid_is_read(mut bytes in prop::collection::vec(any::<u8>(), 0..600), whole in any::<bool>()) {
            if whole && bytes.len() > 200 {
                bytes[..8].copy_from_slice(&[0, 255, 255, 255, 255, 255, 255, 0]);
                bytes[128] = 2;
            }
            let _ = is_dvi(&bytes);
        }
    }
}
