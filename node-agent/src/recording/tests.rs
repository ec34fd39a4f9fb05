//! Recordings made by hand or by the writer, and what the reader finds in them.

use std::fs;
use std::io::Write;

use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};
use serde_json::{Value, json};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::*;

/// Rounding of a step fitted to frequencies, hertz.
const STEP_TOLERANCE_HZ: f64 = 1e-3;

pub(super) const TX_COUNT: usize = 2;
pub(super) const RX_COUNT: usize = 3;
pub(super) const STEP_COUNT: usize = 20;
pub(super) const SAMPLE_COUNT: usize = TX_COUNT * RX_COUNT * STEP_COUNT;

pub(super) fn header() -> RecordingHeader {
    let array = Array {
        tx_m: vec![[-0.15, 0.0], [0.15, 0.01]],
        rx_m: vec![[-0.1, 0.0], [0.0, 0.02], [0.1, 0.0]],
    };
    let band = Band { step_count: STEP_COUNT, ..Band::default() };
    RecordingHeader { band, array, background: Some(noise(99)), node: Some("Süd-1".to_owned()) }
}

fn noise(seed: u64) -> Vec<Complex<f32>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut part = || rng.random_range(-1.0..1.0);
    (0..SAMPLE_COUNT).map(|_| Complex::new(part(), part())).collect()
}

pub(super) fn sweeps(count: u16) -> Vec<Sweep> {
    (0..count)
        .map(|n| Sweep { time_s: 5.0 + 0.1 * f64::from(n), samples: noise(u64::from(n)) })
        .collect()
}

/// Writes with [`RecordingWriter`].
pub(super) fn write(path: &Path, packing: NpzPacking, header: RecordingHeader, sweeps: &[Sweep]) {
    let mut writer = RecordingWriter::create(path, header).unwrap().packed(packing);
    sweeps.iter().for_each(|sweep| writer.write_sweep(sweep).unwrap());
    writer.finish().unwrap();
}

/// An array as numpy writes it, put together by hand.
pub(super) struct Npy(pub(super) String, pub(super) Vec<u8>);

impl Npy {
    pub(super) fn new(descr: &str, shape: &str, bytes: Vec<u8>) -> Self {
        Self(format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}"), bytes)
    }

    pub(super) fn real(shape: &str, numbers: &[f64]) -> Self {
        Self::new("<f8", shape, numbers.iter().flat_map(|n| n.to_le_bytes()).collect())
    }

    pub(super) fn fortran(mut self) -> Self {
        self.0 = self.0.replace("False", "True");
        self
    }

    fn bytes(&self) -> Vec<u8> {
        let length = u16::try_from(self.0.len() + 1).unwrap().to_le_bytes();
        let head = [b"\x93NUMPY\x01\x00", &length[..], self.0.as_bytes(), b"\n"].concat();
        [head, self.1.clone()].concat()
    }
}

pub(super) type Arrays = Vec<(&'static str, Npy)>;

/// Three sweeps of one transmitter, two receivers and four frequencies; sample number n is n − nj.
pub(super) fn arrays() -> Arrays {
    let echoes = (0..24_u8).flat_map(|n| [f32::from(n), -f32::from(n)]).flat_map(f32::to_le_bytes);
    vec![
        ("echoes", Npy::new("<c8", "(3, 1, 2, 4)", echoes.collect())),
        ("freq_hz", Npy::real("(4,)", &[1e9, 1.1e9, 1.2e9, 1.3e9])),
        ("tx_m", Npy::real("(1, 2)", &[0.0, 0.5])),
        ("rx_m", Npy::real("(2, 2)", &[-0.1, 0.0, 0.1, 0.25])),
    ]
}

pub(super) fn npz(path: &Path, arrays: &Arrays, method: CompressionMethod) {
    let mut zip = ZipWriter::new(File::create(path).unwrap());
    for (name, array) in arrays {
        let options = SimpleFileOptions::default().compression_method(method);
        zip.start_file(format!("{name}.npy"), options).unwrap();
        zip.write_all(&array.bytes()).unwrap();
    }
    zip.finish().unwrap();
}

/// Opens an archive of [`arrays`] with some replaced, added, or (if `None`) left out.
pub(super) fn opened(
    changes: Vec<(&'static str, Option<Npy>)>,
) -> Result<Recording, RecordingError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("walk.npz");
    let mut all = arrays();
    for (name, array) in changes {
        all.retain(|(other, _)| *other != name);
        all.extend(array.map(|array| (name, array)));
    }
    npz(&path, &all, CompressionMethod::Deflated);
    Recording::open(&path)
}

#[test]
fn an_archive_made_by_hand_reads_as_laid_out() {
    let own = Npy::real("(1,)", &[0.0]);
    let mut recording = opened(vec![
        ("period_time_s", Some(Npy::real("(3,)", &[1.0, 1.5, 1.75]))),
        ("x_truth", Some(own)),
    ])
    .unwrap();
    let header = recording.header();
    assert_eq!((header.band.step_count, header.array.tx_m[0]), (4, [0.0, 0.5]));
    assert!((header.band.step_hz - 1e8).abs() < STEP_TOLERANCE_HZ);
    assert_eq!(header.array.rx_m, [[-0.1, 0.0], [0.1, 0.25]]);
    assert_eq!((&header.background, recording.period_count()), (&None, 3));
    for (period, time_s) in [1.0, 1.5, 1.75].into_iter().enumerate() {
        let sweep = recording.next_sweep().unwrap().unwrap();
        assert_eq!(sweep.time_s.to_bits(), f64::to_bits(time_s));
        for (channel, k) in [(0, 0), (0, 3), (1, 0), (1, 2)] {
            let n = (period * 8 + channel * 4 + k) as f32;
            assert_eq!(sweep.samples[channel * 4 + k], Complex::new(n, -n));
        }
    }
    assert_eq!(recording.next_sweep().unwrap(), None);
}

#[test]
fn other_types_and_orders_of_axes_are_converted() {
    let wide = (0..24_u8).flat_map(|n| [f64::from(n), -f64::from(n)]).flat_map(f64::to_be_bytes);
    let whole = [1_000_000_000_i64, 1_100_000_000, 1_200_000_000, 1_300_000_000];
    let turned = Npy::real("(2, 2)", &[-0.1, 0.1, 0.0, 0.25]).fortran();
    let named: Vec<u8> =
        ['a', '\u{df}', '\0'].into_iter().flat_map(|c| u32::from(c).to_le_bytes()).collect();
    let recording = opened(vec![
        ("echoes", Some(Npy::new(">c16", "(3, 1, 2, 4)", wide.collect()))),
        (
            "freq_hz",
            Some(Npy::new("<i8", "(4,)", whole.iter().flat_map(|n| n.to_le_bytes()).collect())),
        ),
        ("rx_m", Some(turned)),
        ("node", Some(Npy::new("<U3", "()", named))),
    ]);
    let plain: Vec<Sweep> = opened(vec![]).unwrap().map(Result::unwrap).collect();
    let recording = recording.unwrap();
    assert_eq!(recording.header().array.rx_m, [[-0.1, 0.0], [0.1, 0.25]]);
    assert_eq!(recording.header().node.as_deref(), Some("a\u{df}"));
    assert!(recording.times().are_assumed());
    assert_eq!(recording.map(Result::unwrap).collect::<Vec<_>>(), plain);
}

#[test]
fn a_sigmf_pair_made_by_hand_reads_as_laid_out() {
    let folder = tempfile::tempdir().unwrap();
    let (meta, data) = pair(folder.path());
    write_meta(&meta, &meta_fields());
    fs::write(&data, hand_data()).unwrap();
    let mut recording = Recording::open(&data).unwrap();
    assert_eq!(recording.times(), &PeriodTimes::Even { first_s: 2.0, period_s: 0.5 });
    // Two leading sweeps, the second of which is 20 more everywhere.
    let background = recording.header().background.clone().unwrap();
    assert_eq!(recording.period_count(), 3);
    for (channel, k) in [(0, 0), (0, 3), (1, 0), (1, 2)] {
        let n = (10 * k + channel) as f32;
        assert_eq!(background[channel * 4 + k], Complex::new(n + 10.0, -n - 10.0));
    }
    recording.skip_sweeps(1).unwrap();
    let sweep = recording.next_sweep().unwrap().unwrap();
    assert!((sweep.time_s - 2.5).abs() < 1e-12);
    for (channel, k) in [(0, 0), (0, 3), (1, 0), (1, 2)] {
        let n = (60 + 10 * k + channel) as f32;
        assert_eq!(sweep.samples[channel * 4 + k], Complex::new(n, -n));
    }
}

pub(super) fn pair(folder: &Path) -> (PathBuf, PathBuf) {
    (folder.join("walk.one.sigmf-meta"), folder.join("walk.one.sigmf-data"))
}

/// Five sweeps of two channels and four frequencies; sample is 20 p + 10 k + c, minus that j.
pub(super) fn hand_data() -> Vec<u8> {
    let value = |index: usize| (20 * (index / 8) + 10 * (index % 8 / 2) + index % 2) as f32;
    (0..40).flat_map(|index| [value(index), -value(index)]).flat_map(f32::to_le_bytes).collect()
}

pub(super) fn meta_fields() -> Value {
    json!({
        "core:datatype": "cf32_le", "core:version": "1.2.3", "core:num_channels": 2,
        "core:extensions": [
            {"name": "transmural", "version": "1.0.0", "optional": false},
            {"name": "antenna", "version": "1.0.0", "optional": true},
        ],
        "core:author": "somebody",
        "transmural:start_hz": 1e9, "transmural:step_hz": 1e8, "transmural:step_count": 4,
        "transmural:tx_m": [[0, 0.5]], "transmural:rx_m": [[-0.1, 0], [0.1, 0.25]],
        "transmural:period_s": 0.5, "transmural:first_s": 2.0,
        "transmural:background_sweep_count": 2,
    })
}

pub(super) fn write_meta(path: &Path, global: &Value) {
    let text = json!({"global": global, "captures": [], "annotations": []}).to_string();
    fs::write(path, text).unwrap();
}

#[test]
fn what_is_written_is_read_again_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let (meta, _) = pair(folder.path());
    let npz = |name: &str| folder.path().join(name);
    for (path, packing) in [
        (npz("a.npz"), NpzPacking::Stored),
        (npz("b.npz"), NpzPacking::Deflated),
        (meta, NpzPacking::Stored),
    ] {
        let bare = RecordingHeader { background: None, node: None, ..header() };
        for header in [header(), bare] {
            write(&path, packing, header.clone(), &sweeps(5));
            let mut recording = Recording::open(&path).unwrap();
            let read = recording.header();
            assert!((read.band.step_hz - header.band.step_hz).abs() < STEP_TOLERANCE_HZ);
            let band = header.band;
            assert_eq!(RecordingHeader { band, ..read.clone() }, header);
            assert_eq!(recording.by_ref().map(Result::unwrap).collect::<Vec<_>>(), sweeps(5));
            recording.rewind().unwrap();
            recording.skip_sweeps(3).unwrap();
            assert_eq!(recording.next_index(), 3);
            assert_eq!(recording.next_sweep().unwrap().as_ref(), sweeps(5).get(3));
            recording.skip_sweeps(100).unwrap();
            assert_eq!(recording.next_sweep().unwrap(), None);
            recording.rewind().unwrap();
            let conjugated = recording.conjugated().next_sweep().unwrap().unwrap();
            assert_eq!(conjugated.samples[7], sweeps(1)[0].samples[7].conj());
        }
    }
}

#[test]
fn the_final_name_appears_with_the_whole_recording_only() {
    let folder = tempfile::tempdir().unwrap();
    let (meta, data) = pair(folder.path());
    for path in [folder.path().join("a.npz"), meta.clone()] {
        let mut writer = RecordingWriter::create(&path, header()).unwrap();
        writer.write_sweep(&sweeps(1)[0]).unwrap();
        assert!(!path.exists() && !data.exists());
        drop(writer);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }
    let none = RecordingWriter::create(&meta, header()).unwrap().finish().unwrap_err();
    assert!(matches!(*none.fault, RecordingFault::NoPeriods));
}

#[test]
fn the_writer_refuses_what_the_reader_would() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let mut writer = RecordingWriter::create(&path, header()).unwrap();
    let good = sweeps(2);
    writer.write_sweep(&good[1]).unwrap();
    let mut hole = Sweep { time_s: 9.0, samples: good[0].samples.clone() };
    hole.samples[STEP_COUNT * 4 + 3].im = f32::INFINITY;
    let place = Place { period_index: 1, tx_index: 1, rx_index: 1, frequency_index: 3 };
    let refused = |outcome: Result<(), RecordingError>| *outcome.unwrap_err().fault;
    let found = refused(writer.write_sweep(&hole));
    assert!(matches!(found, RecordingFault::SampleNotFinite { place: p, .. } if p == place));
    let late = refused(writer.write_sweep(&good[0]));
    assert!(matches!(late, RecordingFault::TimesNotAscending { index: 1, .. }));
    let short = Sweep { time_s: 9.0, samples: vec![] };
    assert!(matches!(refused(writer.write_sweep(&short)), RecordingFault::Shape { .. }));
    writer.finish().unwrap();
    let read: Vec<Sweep> = Recording::open(&path).unwrap().map(Result::unwrap).collect();
    assert_eq!(read, good[1..]);
    let create = |at: &Path, header| fault_of(RecordingWriter::create(at, header));
    let named = create(&folder.path().join("a.mat"), header());
    assert!(matches!(named, RecordingFault::UnknownKind));
    let wrong = RecordingHeader { background: Some(vec![]), ..header() };
    assert!(matches!(create(&path, wrong), RecordingFault::Shape { .. }));
    let band = Band { step_hz: -1.0, ..Band::default() };
    let impossible = RecordingHeader { band, ..header() };
    assert!(matches!(create(&path, impossible), RecordingFault::Radar(_)));
    let nowhere = create(&folder.path().join("none/a.npz"), header());
    assert!(matches!(nowhere, RecordingFault::Write { .. }));
}

pub(super) fn fault_of<T: std::fmt::Debug>(outcome: Result<T, RecordingError>) -> RecordingFault {
    *outcome.unwrap_err().fault
}

#[test]
fn the_opposite_phase_is_named_and_can_be_turned() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let band = Band { step_count: 64, step_hz: 4e6, ..Band::default() };
    let header = RecordingHeader { band, background: None, ..header() };
    let turned = |m: u32, delay_s: f64| Sweep {
        time_s: f64::from(m),
        samples: (0..6 * 64)
            .map(|n| Complex::cis(std::f64::consts::TAU * band.frequency_hz(n % 64) * delay_s))
            .map(|s| Complex::new(crate::imaging::single(s.re), crate::imaging::single(s.im)))
            .collect(),
    };
    let sweeps: Vec<Sweep> = (0..20).map(|m| turned(m, 40e-9 + 1e-9 * f64::from(m))).collect();
    write(&path, NpzPacking::Stored, header, &sweeps);
    let mut recording = Recording::open(&path).unwrap();
    let error = recording.check_phase().unwrap_err();
    assert!(error.to_string().contains("--conjugate"), "{error}");
    let mut right = recording.conjugated();
    assert_eq!(right.check_phase().unwrap(), PhaseSign::AsDocumented);
    assert_eq!(right.next_index(), 0);
}
