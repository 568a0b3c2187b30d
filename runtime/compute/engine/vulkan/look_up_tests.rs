//! Compares first phases on the device with the host's.

use super::engine::VulkanEngine;
use crate::engine::{Buffer, Engine, EngineError, LookUp};
use crate::gpu::Gpu;
use crate::gpu::test_options::watched;
use crate::optics::{Optics, WindowFactor};
use crate::plan::{Planner, Purpose, Storage, ViewLayout};
use crate::scene::{Pyramid, ViewGrid};
use eyebox_kernels::table_start::LEVELS;
use eyebox_kernels::{pupil_light, table_start};
use std::sync::{Arc, PoisonError};

const FRAMES: usize = 5;

fn planner([height, width]: [usize; 2]) -> (Planner, Arc<Pyramid>) {
    let slm = Optics::new(height, width, 8e-6, 520e-9, 0.4).unwrap();
    let of = |v: usize| (0..height * width).map(|i| ((i * 37 + v * 101) % 211) as f32 / 150.0).collect();
    let views: Vec<Vec<f32>> = (0..9).map(of).collect();
    let pyramid = Arc::new(Pyramid::new(&views, height, width));
    let grid = ViewGrid { rows: 3, columns: 3, cell: slm.eyebox() / 3.0 };
    let views = Some(ViewLayout::new(grid, &pyramid));
    (Planner { views, ..Planner::new(slm, FRAMES, WindowFactor::Two) }, pyramid)
}

/// Returns an arbitrary table of odd size.
fn of([height, width]: [usize; 2], views: &Arc<Pyramid>, bright: f64, shaded: bool) -> LookUp {
    let [rows, columns, pixels] = [height, width, height * width].map(|n| n as u32);
    let parts = [(0, 0.1), (2, 0.25), (4, 0.3), (5, 0.05), (8, 0.3)];
    let shares = pupil_light::shares(&parts);
    let (side, count) = (7, FRAMES * 49 * LEVELS);
    let place = pupil_light::Args {
        height: rows,
        width: columns,
        line: columns,
        first: 0,
        stride: pixels,
        from: 0,
        begin: 0,
        end: shares.len() as u32,
        adds: 0,
    };
    let args = table_start::Args {
        height: rows,
        width: columns,
        side,
        first: 0,
        frames: FRAMES as u32,
        factor: 0,
        shift: 0,
        evenly_lit: 1,
        stride: pixels,
        angles: 1,
    };
    let needs = (0..pixels).map(|i| table_start::need(0.1 + (i % 9) as f32 / 4.0));
    LookUp {
        table: (0..count).map(|i| (i * 26_881 % 65_536) as u16).collect(),
        views: Arc::clone(views),
        shares,
        place,
        args: args.brightness(bright),
        needs: shaded.then(|| needs.collect()),
    }
}

/// The device looks up the same bits as the host. The cases are phases and binary angles, and pixels in odd numbers,
/// dark, bright and unevenly lit. They include other tables and pictures afterwards, and kernels that bind few views
/// and sub-frames at a time.
#[test]
fn the_device_looks_up_what_the_host_does() {
    let gpu = Gpu::open(&watched()).unwrap();
    let mut engine = VulkanEngine::new(&gpu).unwrap();
    for (size, range) in [([33, 27], None), ([48, 64], None), ([40, 64], Some(2 * 4 * 40 * 64 + 512))] {
        if let Some(bytes) = range {
            engine.pretend_range(bytes);
        }
        let (planner, pyramid) = planner(size);
        for storage in [Storage::F32, Storage::F16] {
            let binary_angles = storage == Storage::F16;
            let planner = Planner { storage, binary_angles, ..planner.clone() };
            engine.load(&planner.shape(Purpose::Project), Some(Arc::clone(&pyramid))).unwrap();
            for (bright, shaded) in [(1.7, false), (1e-4, false), (9e4, false), (0.9, true), (0.9, true)] {
                let of = of(size, &pyramid, bright, shaded);
                engine.look_up(&of).unwrap();
                let (got, wanted) = (engine.read(Buffer::Phases).unwrap(), of.phases().unwrap());
                assert!(got == wanted, "{size:?} {storage:?} {bright}");
            }
        }
    }
    let (_, pyramid) = planner([48, 64]);
    assert!(matches!(engine.look_up(&of([48, 64], &pyramid, 1.0, false)), Err(EngineError::Mismatch { .. })));
    let messages = engine.gpu().messages();
    drop((engine, gpu));
    assert_eq!(*messages.lock().unwrap_or_else(PoisonError::into_inner), Vec::<String>::new());
}
