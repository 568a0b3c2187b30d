//! Lists the connectors of the system's graphics cards, as names for displays without a desktop (Linux).

use std::fs;
use std::path::{Path, PathBuf};

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Connector {
    /// The card, such as `/dev/dri/card0`.
    pub(super) card: PathBuf,
    /// The name in the kernel, such as `HDMI-A-1`.
    pub(super) name: String,
    /// The number in the kernel, which Linux 6.0 and newer report.
    pub(super) id: Option<u32>,
    /// The name that the monitor reports.
    pub(super) monitor: Option<String>,
}

/// The connectors with a plugged monitor. `classes` is `/sys/class/drm`, `devices` is `/dev/dri`.
pub(super) fn connectors(classes: &Path, devices: &Path) -> Vec<Connector> {
    let Ok(entries) = fs::read_dir(classes) else { return Vec::new() };
    let read = |folder: &Path, name: &str| fs::read_to_string(folder.join(name)).unwrap_or_default();
    let one = |entry: fs::DirEntry| {
        let (folder, file) = (entry.path(), entry.file_name().into_string().ok()?);
        // An example of a name is card0-HDMI-A-1.
        let (card, name) = file.split_once('-').filter(|(card, _)| card.starts_with("card"))?;
        if read(&folder, "status").trim() != "connected" {
            return None;
        }
        Some(Connector {
            card: devices.join(card),
            name: name.into(),
            id: read(&folder, "connector_id").trim().parse().ok(),
            monitor: fs::read(folder.join("edid")).ok().and_then(|edid| monitor_name(&edid)),
        })
    };
    let mut found: Vec<Connector> = entries.flatten().filter_map(one).collect();
    found.sort_by(|a, b| (&a.card, &a.name).cmp(&(&b.card, &b.name)));
    found
}

/// The name in an EDID, which is the descriptor 0xFC of its first block, if there is one.
fn monitor_name(edid: &[u8]) -> Option<String> {
    let descriptors = edid.get(54..126).filter(|_| edid.starts_with(&[0, 255, 255, 255, 255, 255, 255, 0]))?;
    let name = descriptors.chunks_exact(18).find(|d| d[..5] == [0, 0, 0, 0xFC, 0])?;
    let text = name[5..].split(|b| *b == b'\n').next()?;
    let text: String = text.iter().map(|b| if b.is_ascii_graphic() || *b == b' ' { *b as char } else { '?' }).collect();
    Some(text.trim().to_owned()).filter(|t| !t.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn edid(name: &[u8; 13]) -> Vec<u8> {
        let mut edid = vec![0; 128];
        edid[..8].copy_from_slice(&[0, 255, 255, 255, 255, 255, 255, 0]);
        edid[54..59].copy_from_slice(&[0x02, 0x3a, 0x80, 0x18, 0x71]);
        edid[72 + 3] = 0xFD;
        edid[90 + 3] = 0xFC;
        edid[95..108].copy_from_slice(name);
        edid
    }

    #[test]
    fn what_is_plugged_in_is_found_by_name_number_and_monitor() {
        let here = tempfile::tempdir().unwrap();
        let connector = |name: &str, status: &str, id: &str, edid: &[u8]| {
            let at = here.path().join(name);
            fs::create_dir(&at).unwrap();
            fs::write(at.join("status"), status).unwrap();
            if !id.is_empty() {
                fs::write(at.join("connector_id"), id).unwrap();
            }
            fs::write(at.join("edid"), edid).unwrap();
        };
        connector("card1-DP-2", "connected\n", "95\n", &edid(b"PLUTO-2\n     "));
        connector("card0-HDMI-A-1", "connected\n", "", &[]);
        connector("card0-DP-1", "disconnected\n", "80\n", &[]);
        connector("renderD128", "", "", &[]);
        fs::write(here.path().join("version"), "drm 1.1.0").unwrap();
        let found = connectors(here.path(), Path::new("/dev/dri"));
        let of = |card: &str, name: &str, id, monitor: Option<&str>| Connector {
            card: Path::new("/dev/dri").join(card),
            name: name.into(),
            id,
            monitor: monitor.map(Into::into),
        };
        assert_eq!(found, [of("card0", "HDMI-A-1", None, None), of("card1", "DP-2", Some(95), Some("PLUTO-2"))]);
        assert_eq!(connectors(&here.path().join("none"), Path::new("/dev/dri")), []);
    }

    proptest! {
        #[test]
        fn any_edid_has_a_name_or_none(mut bytes in prop::collection::vec(any::<u8>(), 0..300), whole in any::<bool>()) {
            if whole && bytes.len() > 8 {
                bytes[..8].copy_from_slice(&[0, 255, 255, 255, 255, 255, 255, 0]);
            }
            let name = monitor_name(&bytes);
            prop_assert!(name.is_none_or(|n| !n.is_empty() && n.len() <= 13 && n.is_ascii()));
        }
    }
}
