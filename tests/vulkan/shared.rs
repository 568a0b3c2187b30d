//! Memory of a device that an application uses too. Two devices of one process run under the validation layer. Views go
//! from one device to the other and never to the host.
#![cfg(target_os = "linux")]

use eyebox::low_level::engine::EngineError;
use eyebox::low_level::engine::vulkan::{StoredViews, ViewDecoder};
use eyebox::low_level::gpu::{DeviceIds, Gpu, SharedLayout, SharedMemory, SlotWriter};
use eyebox_kernels::decode_views::U8;
use eyebox_tests::both::{gpu, watched};
use std::sync::PoisonError;

const SIDE: usize = 48;
const VIEWS: usize = 9;

fn silent(gpus: [Gpu; 2]) {
    let messages = gpus.each_ref().map(Gpu::messages);
    drop(gpus);
    for messages in messages {
        let heard = messages.lock().unwrap_or_else(PoisonError::into_inner);
        assert!(heard.is_empty(), "messages of the validation layer:\n{}", heard.join("\n"));
    }
}

/// Opens another device of this process, as an application does.
fn same(gpu: &Gpu) -> Gpu {
    Gpu::open_same(gpu.ids(), &watched()).unwrap_or_else(|e| panic!("{e}"))
}

/// Returns a picture that no other frame has.
fn samples(seed: usize) -> Vec<u8> {
    (0..VIEWS * SIDE * SIDE).map(|i| (i * 31 + seed * 77 + i / 7 * seed) as u8).collect()
}

#[test]
fn memory_is_the_other_device_s_too() {
    let ours = gpu();
    assert!(ours.shares_memory(), "lavapipe and GPUs on Linux share memory");
    let theirs = same(&ours);
    let (bytes, slots, stride) = ((VIEWS * SIDE * SIDE) as u64, 3, 20_992);
    let (memory, fd) = SharedMemory::export(&ours, slots * stride).expect("shared");
    let layout = memory.layout();
    // A layout is checked before the driver receives it.
    let wrong = [
        SharedLayout { memory_type: 31, ..layout },
        SharedLayout { memory_type: 1 << 20, ..layout },
        SharedLayout { memory_bytes: 4, ..layout },
        SharedLayout { usage: 1, ..layout },
        SharedLayout { buffer_bytes: u64::MAX, ..layout },
        SharedLayout { buffer_bytes: 0, ..layout },
    ];
    for layout in wrong {
        let again = fd.try_clone().expect("a descriptor");
        assert!(SharedMemory::import(&theirs, again, &layout).is_err(), "{layout:?}");
    }
    let mut writer = SlotWriter::new(&theirs, fd, &layout, stride).expect("imported");
    let mut decoder = ViewDecoder::new(&ours, [SIDE, SIDE], 1, &[0], bytes).expect("a decoder");
    let stored = StoredViews { grid: [3, 3], sample: U8, coded: false, planar: false };
    let numbers = [1, 2].map(|seed| writer.keep(None, &samples(seed)).expect("kept"));
    for (slot, number, seed) in [(0, numbers[0], 1), (2, numbers[1], 2), (0, numbers[1], 2)] {
        let before = [&ours, &theirs].map(Gpu::counts);
        writer.write(slot, number).expect("written");
        decoder.copy(&memory, slot as u64 * stride, bytes).expect("copied");
        let moved = [ours.counts().since(before[0]), theirs.counts().since(before[1])];
        assert!(moved.iter().all(|m| (m.uploaded, m.read_back) == (0, 0)), "{moved:?}");
        let lights = decoder.measure(&stored).expect("measured").expect("light");
        let pyramid = decoder.decode(&stored, &lights).expect("decoded").remove(0).on_host().expect("read");
        let scale = pyramid.scale / 65_535.0 * 255.0;
        let found: Vec<u8> = pyramid.levels[0].views.iter().map(|v| (f32::from(*v) * scale).round() as u8).collect();
        assert!(found == samples(seed), "slot {slot}");
    }
    // These are beyond the slots and beyond the samples.
    assert!(
        writer.write(3, numbers[0]).is_err() && writer.write(0, 7).is_err() && writer.write(usize::MAX, 0).is_err()
    );
    for (at, bytes) in [(slots * stride, 4), (u64::MAX, 8), (0, bytes + 4), (2, 4)] {
        assert!(decoder.copy(&memory, at, bytes).is_err(), "{bytes} at {at}");
    }
    let other = DeviceIds { driver: [7; 16], ..ours.ids() };
    assert!(matches!(Gpu::open_same(other, &watched()), Err(EngineError::NoDevice { .. })));
    drop((writer, decoder, memory));
    silent([ours, theirs]);
}
