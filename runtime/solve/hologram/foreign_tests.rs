//! Tests Zarr stores of other programs, which are read or refused with the line that copies them.

use super::*;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

const SHAPE: [usize; 4] = [2, 3, 6, 8];

fn phase(index: [usize; 4]) -> f32 {
    let place = index.iter().zip(SHAPE).fold(0, |at, (i, n)| at * n + i);
    (place as f32 * 0.37).rem_euclid(6.0) - 3.0
}

/// Writes a store with chunks of this shape. `change` edits the array's document, and `bytes` encodes a value.
fn store(at: &Path, chunk: [usize; 4], change: impl Fn(&mut Value), bytes: impl Fn(f32) -> Vec<u8>) {
    let _ = fs::remove_dir_all(at);
    fs::create_dir_all(at.join("phases")).unwrap();
    let colors = json!([{"color": "red", "wavelength_nm": 660.0}, {"color": "green", "wavelength_nm": 520.0}]);
    let eyebox = json!({"format": 1, "pitch_um": 8.0, "focal_length_mm": 400.0, "colors": colors});
    let group = json!({"zarr_format": 3, "node_type": "group", "attributes": {"eyebox": eyebox}});
    fs::write(at.join("zarr.json"), group.to_string()).unwrap();
    let mut array = json!({
        "zarr_format": 3, "node_type": "array", "shape": SHAPE, "data_type": "float32",
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": chunk}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "fill_value": 0.0, "codecs": [{"name": "bytes", "configuration": {"endian": "little"}}], "attributes": {},
    });
    change(&mut array);
    fs::write(at.join("phases/zarr.json"), array.to_string()).unwrap();
    let separator = array["chunk_key_encoding"]["configuration"]["separator"].as_str().unwrap_or("/").to_owned();
    let grid = [0, 1, 2, 3].map(|i| SHAPE[i].div_ceil(chunk[i]));
    for n in 0..grid.iter().product() {
        let at_chunk = index(n, grid);
        let values = (0..chunk.iter().product()).flat_map(|i| {
            let inside = index(i, chunk);
            let place = [0, 1, 2, 3].map(|k| at_chunk[k] * chunk[k] + inside[k]);
            // Values beyond the array fill the chunk.
            bytes(if place.iter().zip(SHAPE).all(|(p, n)| *p < n) { phase(place) } else { 99.0 })
        });
        let name =
            ["c".to_owned()].into_iter().chain(at_chunk.map(|i| i.to_string())).collect::<Vec<_>>().join(&separator);
        let file = at.join("phases").join(name);
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(file, values.collect::<Vec<u8>>()).unwrap();
    }
}

fn index(n: usize, shape: [usize; 4]) -> [usize; 4] {
    let [_, b, c, d] = shape;
    [n / (b * c * d), n / (c * d) % b, n / d % c, n % d]
}

fn little(v: f32) -> Vec<u8> {
    v.to_le_bytes().to_vec()
}

fn right(hologram: &Hologram) -> bool {
    let [colors, frames, height, width] = SHAPE;
    let all = (0..colors).all(|color| {
        let phases = &hologram.colors[color].phases;
        phases.len() == frames * height * width
            && phases.iter().enumerate().all(|(i, p)| *p == phase(index(color * frames * height * width + i, SHAPE)))
    });
    all && (hologram.frames, hologram.height, hologram.width) == (frames, height, width)
}

#[test]
fn chunks_of_any_shape_and_float64_are_read() {
    let here = tempfile::tempdir().unwrap();
    let at = here.path().join("h.zarr");
    let none = |_: &mut Value| {};
    for chunk in [[1, 1, 6, 8], [1, 1, 3, 4], [2, 3, 6, 8], [1, 2, 4, 5], [1, 1, 1, 1], [1, 3, 3, 3], [2, 3, 50, 70]] {
        store(&at, chunk, none, little);
        assert!(right(&Hologram::load(&at).unwrap()), "{chunk:?}");
        assert!(right(&Sequence::open(&at).unwrap().load(0).unwrap()), "{chunk:?}");
    }
    let wide = |array: &mut Value| array["data_type"] = json!("float64");
    store(&at, [1, 1, 6, 8], wide, |v| f64::from(v).to_le_bytes().to_vec());
    assert!(right(&Hologram::load(&at).unwrap()));
    let big = |array: &mut Value| array["codecs"][0]["configuration"]["endian"] = json!("big");
    store(&at, [1, 1, 6, 8], big, |v| v.to_be_bytes().to_vec());
    assert!(right(&Hologram::load(&at).unwrap()));
    let dots = |array: &mut Value| array["chunk_key_encoding"]["configuration"]["separator"] = json!(".");
    store(&at, [1, 1, 3, 8], dots, little);
    assert!(right(&Hologram::load(&at).unwrap()));
    // A missing chunk holds the fill value.
    store(&at, [1, 1, 3, 8], |array| array["fill_value"] = json!(0.5), little);
    fs::remove_file(at.join("phases/c/0/0/0/0")).unwrap();
    let hologram = Hologram::load(&at).unwrap();
    assert!(hologram.colors[0].phases[..24].iter().all(|p| *p == 0.5));
    assert_eq!(hologram.colors[0].phases[24], phase([0, 0, 3, 0]));
    // A chunk that is cut short is damaged.
    fs::write(at.join("phases/c/0/0/1/0"), [0; 5]).unwrap();
    assert!(matches!(Hologram::load(&at), Err(HologramError::Damaged { .. })));
}

#[test]
fn what_is_not_read_is_named_with_the_line_that_copies_it() {
    let here = tempfile::tempdir().unwrap();
    let at = here.path().join("h.zarr");
    let codec = |name: &'static str| {
        move |array: &mut Value| {
            array["codecs"].as_array_mut().unwrap().push(json!({"name": name, "configuration": {}}))
        }
    };
    type Change = Box<dyn Fn(&mut Value)>;
    let cases: [(&str, &str, Change); 7] = [
        ("compressed", "zstd", Box::new(codec("zstd"))),
        ("compressed", "gzip", Box::new(codec("gzip"))),
        ("compressed", "blosc", Box::new(codec("blosc"))),
        ("shards", "", Box::new(codec("sharding_indexed"))),
        ("codec", "transpose", Box::new(codec("transpose"))),
        ("foreign-type", "int16", Box::new(|array| array["data_type"] = json!("int16"))),
        ("foreign-shape", "[6,8]", Box::new(|array| array["shape"] = json!([6, 8]))),
    ];
    for (code, what, change) in cases {
        store(&at, [1, 1, 6, 8], change, little);
        for error in [Hologram::load(&at).unwrap_err(), Sequence::open(&at).unwrap_err()] {
            let HologramError::NotAHologram { reason, .. } = error else { panic!("{what}: {error}") };
            assert_eq!(reason.code(), code, "{what}: {reason}");
            assert!(reason.text().contains(what) && reason.text().contains("python -c"), "{what}: {reason}");
        }
    }
    // Version 2 has other documents.
    fs::remove_dir_all(&at).unwrap();
    fs::create_dir_all(at.join("phases")).unwrap();
    fs::write(at.join(".zgroup"), "{\"zarr_format\": 2}").unwrap();
    let error = Hologram::load(&at).unwrap_err();
    let HologramError::NotAHologram { reason, .. } = error else { panic!("{error}") };
    assert!(reason.code() == "zarr-2" && reason.text().contains("python -c"), "{reason}");
}

#[test]
fn attributes_that_another_program_changed_are_told_from_damage() {
    let here = tempfile::tempdir().unwrap();
    let at = here.path().join("h.zarr");
    store(&at, [1, 1, 6, 8], |_| {}, little);
    let whole = Hologram { version: "0.1.0".into(), ..Hologram::load(&at).unwrap() };
    whole.save(&at).unwrap();
    let file = at.join("zarr.json");
    let ours = fs::read(&file).unwrap();
    // One changed letter is damage.
    let mut flipped = ours.clone();
    let place = flipped.windows(5).position(|w| w == b"pitch").unwrap();
    flipped[place] = b'q';
    fs::write(&file, &flipped).unwrap();
    assert!(matches!(Hologram::load(&at), Err(HologramError::Damaged { .. })));
    // A document with another layout is a change. Without its checksum it is read.
    let mut document: Value = serde_json::from_slice(&ours).unwrap();
    document["attributes"]["eyebox"]["note"] = json!("mine");
    fs::write(&file, serde_json::to_vec_pretty(&document).unwrap()).unwrap();
    let error = Hologram::load(&at).unwrap_err();
    let HologramError::Doubtful { reason, decide, .. } = error else { panic!("{error}") };
    assert!(reason.code() == "rewritten" && decide.contains("document_crc32c"), "{decide}");
    document["attributes"].as_object_mut().unwrap().remove("document_crc32c");
    document["attributes"]["eyebox"].as_object_mut().unwrap().remove("version");
    fs::write(&file, document.to_string()).unwrap();
    assert!(right(&Hologram::load(&at).unwrap()));
}
