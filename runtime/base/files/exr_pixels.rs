//! Chooses and reads the channels of OpenEXR files, as renderers write them.

use super::{FileError, Pixels, Primaries, Samples, Wanted, read};
use crate::error::Reason;
use crate::reason;
use exr::block::reader::{ChunksReader, Reader};
use exr::compression::Compression;
use exr::meta::attribute::{ChannelDescription, Chromaticities, SampleType};
use exr::meta::header::Header;
use std::{fs::File, io::BufReader, path::Path};

/// Channels of one part, in the order of the pixel's values. Channels that are absent are left out.
struct Choice {
    part: usize,
    channels: Vec<usize>,
}

fn open(file: &Path) -> Result<Reader<BufReader<File>>, FileError> {
    exr::block::read(read::buffered(file)?, false).map_err(|e| FileError::damaged(file, e))
}

/// Returns rows and columns of the display window, which all parts share.
pub(super) fn size(file: &Path) -> Result<[usize; 2], FileError> {
    size_of(file, open(file)?.headers())
}

fn size_of(file: &Path, headers: &[Header]) -> Result<[usize; 2], FileError> {
    let window = headers.first().map(|header| header.shared_attributes.display_window.size);
    match window {
        Some(size) if (1..=65536).contains(&size.0) && (1..=65536).contains(&size.1) => Ok([size.1, size.0]),
        _ => Err(FileError::content(
            file,
            reason!("exr-window", "its display window must have 1 to 65536 rows and columns"),
        )),
    }
}

/// Returns the names of the layers with colors in lower case, in the order of the file.
pub(super) fn layers(file: &Path) -> Result<Vec<String>, FileError> {
    let all = all_lower(open(file)?.headers());
    Ok(with_colors(&all).into_iter().map(|(_, layer)| layer.to_owned()).collect())
}

/// Reads colors, or the depth of a depth map. A pixel outside the data window is black, or NaN in a depth map.
pub(super) fn read(file: &Path, wanted: Wanted) -> Result<Pixels, FileError> {
    let reader = open(file)?;
    let (choice, outside) = match wanted {
        Wanted::DepthMap => (depth(reader.headers()), f32::NAN),
        _ => (colors(reader.headers()), 0.0),
    };
    let choice = choice.map_err(|reason| FileError::content(file, reason))?;
    // One choice gives one picture.
    Ok(chosen(file, reader, &[choice], outside)?.swap_remove(0))
}

/// Reads the layers with colors that have these indices among [`layers`], and decompresses the file once for all.
pub(super) fn read_layers(file: &Path, indices: &[u16]) -> Result<Vec<Pixels>, FileError> {
    let reader = open(file)?;
    let choices = layers_of(reader.headers(), indices).map_err(|reason| FileError::content(file, reason))?;
    chosen(file, reader, &choices, 0.0)
}

/// Reads a picture for each choice. A pixel outside the data window has the value `outside`.
fn chosen(
    file: &Path,
    reader: Reader<BufReader<File>>,
    choices: &[Choice],
    outside: f32,
) -> Result<Vec<Pixels>, FileError> {
    let [height, width] = size_of(file, reader.headers())?;
    let headers = reader.headers().to_vec();
    for choice in choices {
        check_storage(&headers[choice.part], &choice.channels).map_err(|reason| FileError::content(file, reason))?;
    }
    let pictures = choices.iter().map(|choice| vec![outside; height * width * choice.channels.len()]);
    let mut pictures: Vec<Vec<f32>> = pictures.collect();
    let is_wanted = |meta: &exr::meta::MetaData, tile: exr::block::chunk::TileCoordinates, part: usize| {
        choices.iter().any(|choice| choice.part == part)
            && !meta.headers[part].deep
            && tile.is_largest_resolution_level()
    };
    let chunks = reader.filter_chunks(false, |meta, tile, block| is_wanted(meta, tile, block.layer));
    let mut blocks = chunks.map_err(|e| FileError::damaged(file, e))?.sequential_decompressor(false);
    while let Some(block) = blocks.decompress_next_block() {
        let block = block.map_err(|e| FileError::damaged(file, e))?;
        let part = block.index.layer;
        let header = &headers[part];
        let offset = header.own_attributes.layer_position - header.shared_attributes.display_window.position;
        for line in block.lines(&header.channels) {
            let (x, y) = (line.location.position.0 as i64, line.location.position.1 as i64 + i64::from(offset.1));
            if !(0..height as i64).contains(&y) {
                continue;
            }
            let channel = line.location.channel;
            let of_part = choices.iter().zip(&mut pictures).filter(|(choice, _)| choice.part == part);
            for (choice, values) in of_part {
                let count = choice.channels.len();
                for (k, _) in choice.channels.iter().enumerate().filter(|(_, own)| **own == channel) {
                    let kind = header.channels.list[channel].sample_type;
                    let samples = samples(line, kind).map_err(|e| FileError::damaged(file, e))?;
                    for (x, value) in (x + i64::from(offset.0)..).zip(samples) {
                        if (0..width as i64).contains(&x) {
                            values[(y as usize * width + x as usize) * count + k] = value;
                        }
                    }
                }
            }
        }
    }
    let pixels = |(choice, values): (&Choice, Vec<f32>)| {
        let primaries = headers[choice.part].shared_attributes.chromaticities.map(primaries);
        let pixels = Pixels::new([height, width], choice.channels.len(), Samples::F32(values));
        Pixels { premultiplied: true, primaries, ..pixels }
    };
    Ok(choices.iter().zip(pictures).map(pixels).collect())
}

/// Refuses channels that are stored in a way that is not read.
fn check_storage(header: &Header, channels: &[usize]) -> Result<(), Reason> {
    let list = &header.channels.list;
    if header.deep || channels.iter().any(|&i| list[i].sampling.0 != 1 || list[i].sampling.1 != 1) {
        let deep = "it holds deep or subsampled pixels, which are not read: save it with plain R, G and B";
        return Err(Reason::new("deep-pixels", deep));
    }
    if matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_)) {
        return Err(reason!("dwa", "it is compressed by DWA, which is not read: save it with ZIP or PIZ"));
    }
    Ok(())
}

fn primaries(stated: Chromaticities) -> Primaries {
    Primaries([stated.red, stated.green, stated.blue, stated.white].map(|at| [at.0, at.1].map(f64::from)))
}

fn samples(line: exr::block::lines::LineRef<'_>, kind: SampleType) -> exr::error::Result<Vec<f32>> {
    match kind {
        SampleType::F16 => line.read_samples::<half::f16>().map(|v| v.map(half::f16::to_f32)).collect(),
        SampleType::F32 => line.read_samples::<f32>().collect(),
        SampleType::U32 => line.read_samples::<u32>().map(|v| v.map(|v| v as f32)).collect(),
    }
}

/// Returns a channel's full name. In files of several parts, the name of the part comes before it.
fn full_name(headers: &[Header], part: usize, channel: &ChannelDescription) -> String {
    let name = channel.name.to_string();
    match &headers[part].own_attributes.layer_name {
        Some(layer) if headers.len() > 1 && !layer.to_string().is_empty() && !name.contains('.') => {
            format!("{layer}.{name}")
        }
        _ => name,
    }
}

/// Lists part, number and full name of each channel.
fn all(headers: &[Header]) -> impl Iterator<Item = (usize, usize, String)> {
    headers.iter().enumerate().flat_map(move |(part, header)| {
        let name = move |(i, c): (usize, &ChannelDescription)| (part, i, full_name(headers, part, c));
        header.channels.list.iter().enumerate().map(name)
    })
}

/// Lists the channels with their names in lower case.
fn all_lower(headers: &[Header]) -> Vec<(usize, usize, String)> {
    all(headers).map(|(part, i, name)| (part, i, name.to_lowercase())).collect()
}

/// Splits a channel's name into its layer and the rest.
fn split(name: &str) -> (&str, &str) {
    name.rsplit_once('.').unwrap_or(("", name))
}

fn names(headers: &[Header]) -> String {
    all(headers).take(12).map(|(_, _, name)| name).collect::<Vec<_>>().join(", ")
}

/// Finds the channel that is the `last` part of a name in a layer of a part.
fn channel_of(all: &[(usize, usize, String)], (part, layer): (usize, &str), last: &str) -> Option<usize> {
    all.iter().find(|(p, _, name)| *p == part && split(name) == (layer, last)).map(|(_, i, _)| *i)
}

/// Returns the part and the name of each layer that has red, green and blue.
fn with_colors(all: &[(usize, usize, String)]) -> Vec<(usize, &str)> {
    all.iter()
        .filter(|(_, _, name)| split(name).1 == "r")
        .map(|(part, _, name)| (*part, split(name).0))
        .filter(|layer| ["g", "b"].iter().all(|c| channel_of(all, *layer, c).is_some()))
        .collect()
}

/// Returns the channels for red, green, blue and alpha of a layer.
fn choice(all: &[(usize, usize, String)], layer: (usize, &str)) -> Choice {
    let channels = ["r", "g", "b", "a"].iter().filter_map(|c| channel_of(all, layer, c)).collect();
    Choice { part: layer.0, channels }
}

/// Chooses the channels of the layers with these indices among the layers with colors.
fn layers_of(headers: &[Header], indices: &[u16]) -> Result<Vec<Choice>, Reason> {
    let all = all_lower(headers);
    let layers = with_colors(&all);
    let one = |index: &u16| {
        let layer = layers.get(usize::from(*index)).map(|layer| choice(&all, *layer));
        layer.ok_or_else(|| {
            reason!("no-layer", "it has no layer {index} with colors. Its channels are {}", names(headers))
        })
    };
    indices.iter().map(one).collect()
}

/// Chooses the channels of a picture. These are red, green, blue and alpha without a layer, of the only layer that has
/// them, or of the layer called Combined, beauty or rgba. Otherwise it is the only channel.
fn colors(headers: &[Header]) -> Result<Choice, Reason> {
    let all = all_lower(headers);
    let mut layers = with_colors(&all);
    let is_beauty = |layer: &str| {
        layer.is_empty() || ["combined", "beauty", "rgba", "rgb"].contains(&layer.rsplit('.').next().unwrap_or(layer))
    };
    if layers.len() > 1 {
        let bare = layers.iter().any(|(_, layer)| layer.is_empty());
        layers.retain(|(_, layer)| if bare { layer.is_empty() } else { is_beauty(layer) });
    }
    match layers[..] {
        [one] => return Ok(choice(&all, one)),
        [] => {}
        _ => {
            return Err(reason!(
                "layers",
                "its channels are {}, and several layers have colors: save only one of them",
                names(headers)
            ));
        }
    }
    let gray: Vec<_> = all.iter().filter(|(_, _, name)| !["a", "z"].contains(&split(name).1)).collect();
    match gray[..] {
        [(part, channel, name)] if !name.contains("depth") => Ok(Choice { part: *part, channels: vec![*channel] }),
        _ => Err(reason!("channels", "its channels are {}: a picture has R, G and B, or one channel", names(headers))),
    }
}

/// Returns true if a file has colors and a channel for depths.
pub(super) fn holds_depth(file: &Path) -> Result<bool, FileError> {
    let reader = open(file)?;
    Ok(colors(reader.headers()).is_ok() && !of_depths(&all_lower(reader.headers())).is_empty())
}

/// Returns the channels that are depths by their names. A layer for depths counts only if no channel is called so.
fn of_depths(all: &[(usize, usize, String)]) -> Vec<&(usize, usize, String)> {
    let by = |is: &dyn Fn(&str) -> bool| all.iter().filter(|(_, _, name)| is(name)).collect::<Vec<_>>();
    // ZBack and similar channels end a deep sample, and are not a depth themselves.
    let last = |name: &str, known: &[&str]| known.contains(&split(name).1);
    let in_depth_layer = |name: &str| split(name).0.rsplit('.').next().is_some_and(|l| l.contains("depth") || l == "z");
    let named = by(&|name| last(name, &["z", "depth", "depthz", "distance"]));
    let layered = || by(&|name| in_depth_layer(name) && last(name, &["r", "x", "v", "y"]));
    if named.is_empty() { layered() } else { named }
}

/// Chooses the channel of a depth map. It is Z or depth, alone or in a layer, or the only channel. Otherwise these are
/// colors, which must be equal.
fn depth(headers: &[Header]) -> Result<Choice, Reason> {
    let all = all_lower(headers);
    let one = |found: &[&(usize, usize, String)]| match found {
        [] => None,
        [(part, channel, _)] => Some(Ok(Choice { part: *part, channels: vec![*channel] })),
        _ => {
            let of = format!("its channels are {}", names(headers));
            Some(Err(reason!(
                "several-depths",
                "{of}, and several of them are depths: save only the one that belongs to the picture"
            )))
        }
    };
    let alone = || Some(all.iter().filter(|(_, _, name)| split(name).1 != "a").collect::<Vec<_>>());
    let found =
        one(&of_depths(&all)).or_else(|| alone().filter(|alone| alone.len() == 1).and_then(|alone| one(&alone)));
    found.unwrap_or_else(|| {
        let colors = colors(headers)?;
        Ok(Choice { channels: colors.channels.into_iter().take(3).collect(), ..colors })
    })
}
