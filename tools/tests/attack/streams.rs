//! Standard output and error that are closed, full, without a reader or with a reader that never reads. Results can
//! also go to a pipe.

use crate::case::{Case, Put, Stream};
use crate::ground::Ground;
use crate::options::sound;

/// Returns a sound run with other streams.
pub fn case(_: &Ground, rng: &mut fastrand::Rng) -> Case {
    if rng.u8(..8) == 0 {
        let run =
            ["show base/h.zarr --display grey8 --size 16x16 --output raw:in/pipe --duration 0.05 --engine cpu"][0];
        return Case::of(&run.split(' ').collect::<Vec<_>>()).put("in/pipe", Put::Fifo);
    }
    let streams = [Stream::Kept, Stream::Closed, Stream::Full, Stream::Gone, Stream::Stuck];
    let mut run = sound(rng);
    if rng.u8(..4) == 0 {
        run.push("-vv");
    }
    let mut case = Case::of(&run);
    // Text that a stream does not accept is lost, but the result may stay.
    case.keeps = true;
    case.streams = [streams[rng.usize(..5)], streams[rng.usize(..5)]];
    case
}
