//! Damaged recordings: a thousand of them give an error or what was recorded, in bounded memory.

use std::fs;

use allocation_counter::measure;
use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};
use zip::CompressionMethod;

use super::tests::{Arrays, Npy, arrays, header, npz, pair, sweeps, write};
use super::*;

/// Memory while a small damaged file is read: two buffers of 64 KiB, that of the unpacker, the
/// archive's directory.
const SMALL_FILE_MEMORY_BYTES: u64 = 1 << 20;
/// Memory for any file of a few hundred kilobytes: the longest list of times, twice as it grows.
const BOMB_MEMORY_BYTES: u64 = 80 << 20;
const SWEEP_COUNT: u16 = 4;
const CASE_COUNT: usize = 1000;

/// All that a reader gets from a file, and whether it was told that something is wrong.
fn read_all(path: &Path) -> (Vec<Sweep>, Option<RecordingError>) {
    let recording = match Recording::open(path) {
        Ok(recording) => recording,
        Err(error) => return (Vec::new(), Some(error)),
    };
    let mut sweeps = Vec::new();
    for outcome in recording {
        match outcome {
            Ok(sweep) => sweeps.push(sweep),
            Err(error) => return (sweeps, Some(error)),
        }
    }
    (sweeps, None)
}

/// Cuts, flips, overwrites or repeats a piece of the bytes.
fn damaged_bytes(bytes: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let place = rng.random_range(0..bytes.len());
    match rng.random_range(0..6) {
        0 => bytes.truncate(place),
        1 => bytes[place] ^= 1 << rng.random_range(0..8),
        2 => (0..8).for_each(|_| {
            let other = rng.random_range(0..bytes.len());
            bytes[other] ^= 1 << rng.random_range(0..8);
        }),
        3 => {
            let end = (place + 8).min(bytes.len());
            bytes[place..end].fill(0xff);
        }
        4 => {
            // A digit of a header becomes another number.
            let digits: Vec<usize> =
                (0..bytes.len()).filter(|index| bytes[*index].is_ascii_digit()).collect();
            let index = digits[rng.random_range(0..digits.len())];
            let huge = [&b"1000000000000000000"[..], b"-1", b"0", b"1e300"];
            let new = huge[rng.random_range(0..huge.len())];
            bytes.splice(index..=index, new.iter().copied());
        }
        _ => {
            let end = (place + 50).min(bytes.len());
            let piece = bytes[place..end].to_vec();
            bytes.splice(place..place, piece);
        }
    }
    bytes
}

#[test]
fn a_thousand_damaged_files_give_an_error_or_what_was_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let (meta, data) = pair(folder.path());
    let (stored, packed) = (folder.path().join("a.npz"), folder.path().join("b.npz"));
    let written = sweeps(SWEEP_COUNT);
    write(&stored, NpzPacking::Stored, header(), &written);
    write(&packed, NpzPacking::Deflated, header(), &written);
    write(&meta, NpzPacking::Stored, header(), &written);
    let files = [&stored, &packed, &meta, &data];
    let intact = files.map(|path| fs::read(path).unwrap());
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let (mut refused, mut partly) = (0, 0);
    for case in 0..CASE_COUNT {
        let index = case % files.len();
        fs::write(files[index], damaged_bytes(&intact[index], &mut rng)).unwrap();
        let mut outcome = (Vec::new(), None);
        let used = measure(|| outcome = read_all(files[index]));
        let (read, error) = outcome;
        assert!(used.bytes_max < SMALL_FILE_MEMORY_BYTES, "case {case}: {} bytes", used.bytes_max);
        // A checksum guards all samples; of metadata only what is impossible can be told.
        if error.is_none() && index != 2 {
            assert!(read == written, "case {case}");
        }
        refused += usize::from(error.is_some());
        partly += usize::from(error.is_some() && !read.is_empty());
        fs::write(files[index], &intact[index]).unwrap();
    }
    // Damage to time stamps of the archive or digits of metadata may go unseen; most is found.
    assert!(800 < refused && refused < CASE_COUNT && 50 < partly, "{refused}, {partly}");
}

#[test]
fn wrong_shapes_and_types_in_a_sound_archive_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    for case in 0..300 {
        let mut all: Arrays = arrays();
        let chosen = rng.random_range(0..all.len());
        let lengths = [0, 1, 2, 3, 4, 5, 1_u64 << 40];
        let axis_count = rng.random_range(0..6);
        let axes: Vec<u64> = (0..axis_count).map(|_| lengths[rng.random_range(0..7)]).collect();
        let shape: String = axes.iter().map(|axis| format!("{axis},")).collect();
        let descr = ["<c8", "<f8", "<f4", ">c16", "|b1", "<U4"][rng.random_range(0..6)];
        let bytes = vec![0; rng.random_range(0..400)];
        let is_as_before = all[chosen].1.1.len() == bytes.len();
        all[chosen].1 = Npy::new(descr, &format!("({shape})"), bytes);
        npz(&path, &all, CompressionMethod::Deflated);
        let used = measure(|| {
            let (_, error) = read_all(&path);
            assert!(error.is_some() || is_as_before, "case {case}: {descr} {axes:?}");
        });
        assert!(used.bytes_max < SMALL_FILE_MEMORY_BYTES, "case {case}: {} bytes", used.bytes_max);
    }
}

#[test]
fn much_from_little_stays_within_limits() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let period_count = 1 << 22;
    let frequencies: Vec<u8> =
        (0..32768).flat_map(|k| (1e9 + 1e5 * f64::from(k)).to_le_bytes()).collect();
    let times = Npy::new("<f8", "(4194304,)", vec![0; 8 * period_count]);
    let many = Npy::new("<c8", "(4194304, 1, 2, 1)", vec![0; 16 * period_count]);
    let antennas = |count: usize| {
        let places = (0..2 * count).flat_map(|n| (0.1 * n as f64).to_le_bytes()).collect();
        Npy::new("<f8", &format!("({count}, 2)"), places)
    };
    let cases: [Arrays; 3] = [
        vec![
            ("echoes", Npy::new("<c8", "(4194304, 1, 2, 4)", vec![0; 64 * period_count])),
            ("period_time_s", times),
        ],
        vec![("echoes", many)],
        vec![
            ("echoes", Npy::new("<c8", "(1, 64, 64, 32768)", vec![0; 1 << 20])),
            ("freq_hz", Npy::new("<f8", "(32768,)", frequencies)),
            ("tx_m", antennas(64)),
            ("rx_m", antennas(64)),
        ],
    ];
    for changes in cases {
        let mut all = arrays();
        all.retain(|(name, _)| changes.iter().all(|(other, _)| other != name));
        all.extend(changes);
        npz(&path, &all, CompressionMethod::Deflated);
        assert!(fs::metadata(&path).unwrap().len() < 1 << 20);
        let used = measure(|| assert!(read_all(&path).1.is_some()));
        assert!(used.bytes_max < BOMB_MEMORY_BYTES, "{} bytes", used.bytes_max);
    }
}

#[test]
fn memory_does_not_grow_with_the_number_of_sweeps() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let mut most = [0, 0];
    for (used_bytes, count) in most.iter_mut().zip([10, 1000]) {
        write(&path, NpzPacking::Stored, header(), &sweeps(count));
        let used = measure(|| {
            let mut recording = Recording::open(&path).unwrap();
            while recording.next_sweep().unwrap().is_some() {}
        });
        *used_bytes = used.bytes_max;
    }
    let listed_bytes = 2 * 8 * 1000;
    assert!(most[1] < most[0] + listed_bytes, "{most:?}");
}
