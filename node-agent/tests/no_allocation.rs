//! Compression and back-projection take no memory once they are warm.

#![expect(clippy::unwrap_used, reason = "a failing set-up is a failing run")]

use std::alloc::System;

use node_agent::imaging::Sweep;
use node_agent::imaging::backproject::{Backprojector, Coherence, Geometry, Means};
use node_agent::imaging::compress::Compressor;
use node_agent::imaging::pixels::Pixels;
use node_agent::imaging::wall::WallModel;
use node_agent::pipeline::{Chain, ChainConfig};
use proto::radar::{Array, Band, Grid};
use rustfft::num_complex::Complex;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

const FRAME_COUNT: usize = 64;

fn samples() -> Vec<Complex<f32>> {
    (0..8 * 301).map(|k| Complex::cis(0.37 * k as f32)).collect()
}

/// Allocations of `FRAME_COUNT` frames after the first ones, at least.
fn allocations(means: &Means) -> usize {
    let (band, array, fft_length) = (Band::default(), Array::default(), 2048);
    let pixels = Pixels::Cartesian(Grid { row_count: 20, ..Grid::default() });
    let geometry = Geometry {
        band: &band,
        array: &array,
        pixels: &pixels,
        wall: &WallModel::None,
        fft_length,
    };
    let projector = Backprojector::with_means(&geometry, means).unwrap();
    let compressor = Compressor::new(&band, &[1.0 / 301.0; 301], fft_length);
    let (mut compressed, mut workspace) = (compressor.memory(8), projector.workspace());
    let (samples, mut amplitude) = (samples(), Vec::new());
    let mut frame = || {
        compressor.compress_into(&samples, &mut compressed);
        projector.project(&compressed.profiles, &mut workspace);
        workspace.image.weighted_amplitude_into(&mut amplitude);
    };
    (0..3).for_each(|_| frame());
    let mut round = || {
        let region = Region::new(ALLOCATOR);
        (0..FRAME_COUNT).for_each(|_| frame());
        region.change().allocations
    };
    // The thread of the test harness may allocate now and then, too.
    (0..5).map(|_| round()).min().unwrap()
}

// One test, so that no other thread of the test harness allocates meanwhile.
#[test]
fn a_warm_chain_takes_no_memory_for_images() {
    for coherence in [Coherence::Power, Coherence::Circular, Coherence::Phase] {
        assert_eq!(allocations(&Means { coherence, ..Means::default() }), 0, "{coherence:?}");
    }
    // The queue through which a pool is given work takes a block for some tens of jobs.
    let shared = allocations(&Means { thread_count: 2, ..Means::default() });
    assert!(shared <= FRAME_COUNT / 8, "{shared} for {FRAME_COUNT} frames");

    let mut chain = Chain::new(&ChainConfig::of_points()).unwrap();
    let mut frame = |number: usize| {
        let sweep = Sweep { time_s: number as f64, samples: vec![Complex::default(); 8 * 301] };
        let region = Region::new(ALLOCATOR);
        assert!(chain.process_sweep(&sweep).unwrap().points.is_empty());
        region.change().bytes_allocated
    };
    (0..3).for_each(|number| assert!(0 < frame(number)));
    // What the canceller gives, the median is taken of and detection marks; a plane of an image alone
    // has 446 kB.
    let largest = (3..20).map(frame).max().unwrap();
    assert!(largest < 200_000, "{largest} bytes");
}
