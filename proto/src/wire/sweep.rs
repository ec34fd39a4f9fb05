//! A raw sweep as a radar's driver sends it to the node agent: a layout that any language writes in
//! two lines, without our codec.
//!
//! Little endian, 48 bytes, then the samples:
//! `magic "TSWP" | version u8 = 1 | 3 bytes of zero | sequence u64 | taken, driver's clock u64 ns |
//! tx count u16 | rx count u16 | step count u32 | start f64 Hz | step f64 Hz`, then complex64
//! samples `[tx][rx][frequency]`, phase convention `exp(−j 2π f τ)`. In Python:
//! `struct.pack("<4sB3xQQHHIdd", b"TSWP", 1, sequence, time_ns, tx, rx, steps, start_hz, step_hz) +
//! samples.astype("<c8").tobytes()`.

use nalgebra::Complex;
use thiserror::Error;

use super::codec::MAX_PAYLOAD_BYTES;
use crate::radar::{Array, Band};

/// Bytes before the samples.
pub const SWEEP_HEADER_BYTES: usize = 48;
const MAGIC: [u8; 4] = *b"TSWP";
const VERSION: u8 = 1;
const SAMPLE_BYTES: usize = 8;

/// One sweep, as a driver delivers it.
#[derive(Clone, Debug, PartialEq)]
pub struct RawSweep {
    /// Counts the driver's sweeps; a gap is a lost sweep.
    pub sequence: u64,
    /// When it was taken, nanoseconds on a clock of the driver that only goes forward.
    pub taken_ns: u64,
    /// Number of transmitters.
    pub tx_count: u16,
    /// Number of receivers.
    pub rx_count: u16,
    /// The frequencies.
    pub band: Band,
    /// Samples `[channel][frequency]`, channel `t · rx_count + r`.
    pub samples: Vec<Complex<f32>>,
}

/// Why bytes were not taken for a sweep of this radar.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum SweepRefusal {
    /// Fewer bytes than a header has.
    #[error("{got} bytes are too short: the header alone has {SWEEP_HEADER_BYTES}")]
    TooShort {
        /// Bytes there.
        got: usize,
    },
    /// Not a sweep.
    #[error("the first bytes are {got:02x?}, not \"TSWP\": this is not a sweep")]
    Foreign {
        /// The first four bytes.
        got: [u8; 4],
    },
    /// Another version of the layout.
    #[error("layout version {got}, this build reads {VERSION}: update the driver or the agent")]
    Version {
        /// Version found.
        got: u8,
    },
    /// The samples are not as many as the header says.
    #[error("the header states {tx_count} x {rx_count} x {step_count} samples, {got} bytes follow")]
    Length {
        /// Transmitters stated.
        tx_count: u16,
        /// Receivers stated.
        rx_count: u16,
        /// Frequencies stated.
        step_count: u32,
        /// Bytes there.
        got: usize,
    },
    /// The radar is not the one configured.
    #[error("{field} is {got}, the configuration says {want}: let driver and [chain] agree")]
    OtherRadar {
        /// Which number.
        field: &'static str,
        /// In the sweep.
        got: f64,
        /// In the configuration.
        want: f64,
    },
}

impl SweepRefusal {
    /// A short label of the reason, for counting.
    #[must_use]
    pub fn label(&self) -> &'static str {
        match self {
            Self::TooShort { .. } => "too_short",
            Self::Foreign { .. } => "foreign",
            Self::Version { .. } => "version",
            Self::Length { .. } => "length",
            Self::OtherRadar { .. } => "other_radar",
        }
    }
}

impl RawSweep {
    /// The most samples that fit into one message.
    pub const MAX_SAMPLE_COUNT: usize = (MAX_PAYLOAD_BYTES - SWEEP_HEADER_BYTES) / SAMPLE_BYTES;

    /// The bytes of the sweep.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(SWEEP_HEADER_BYTES + SAMPLE_BYTES * self.samples.len());
        bytes.extend(MAGIC);
        bytes.extend([VERSION, 0, 0, 0]);
        bytes.extend(self.sequence.to_le_bytes());
        bytes.extend(self.taken_ns.to_le_bytes());
        bytes.extend(self.tx_count.to_le_bytes());
        bytes.extend(self.rx_count.to_le_bytes());
        bytes.extend(u32::try_from(self.band.step_count).unwrap_or(u32::MAX).to_le_bytes());
        bytes.extend(self.band.start_hz.to_le_bytes());
        bytes.extend(self.band.step_hz.to_le_bytes());
        for sample in &self.samples {
            bytes.extend(sample.re.to_le_bytes());
            bytes.extend(sample.im.to_le_bytes());
        }
        bytes
    }

    /// The sweep in `bytes`.
    ///
    /// # Errors
    /// If it is none, is of another version, or has not as many samples as it says.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, SweepRefusal> {
        let Some((header, body)) = bytes.split_first_chunk::<SWEEP_HEADER_BYTES>() else {
            return Err(SweepRefusal::TooShort { got: bytes.len() });
        };
        if part::<4>(header, 0) != MAGIC {
            return Err(SweepRefusal::Foreign { got: part(header, 0) });
        }
        if header[4] != VERSION {
            return Err(SweepRefusal::Version { got: header[4] });
        }
        let tx_count = u16::from_le_bytes(part(header, 24));
        let rx_count = u16::from_le_bytes(part(header, 26));
        let step_count = u32::from_le_bytes(part(header, 28));
        let stated = u64::from(tx_count) * u64::from(rx_count) * u64::from(step_count);
        let got = body.len();
        if stated.checked_mul(SAMPLE_BYTES as u64) != Some(got as u64) {
            return Err(SweepRefusal::Length { tx_count, rx_count, step_count, got });
        }
        let sample = |pair: &[u8; SAMPLE_BYTES]| {
            let half = |at| f32::from_le_bytes(part(pair, at));
            Complex::new(half(0), half(4))
        };
        Ok(Self {
            sequence: u64::from_le_bytes(part(header, 8)),
            taken_ns: u64::from_le_bytes(part(header, 16)),
            tx_count,
            rx_count,
            band: Band {
                start_hz: f64::from_le_bytes(part(header, 32)),
                step_hz: f64::from_le_bytes(part(header, 40)),
                step_count: step_count as usize,
            },
            samples: body.as_chunks::<SAMPLE_BYTES>().0.iter().map(sample).collect(),
        })
    }

    /// Checks that the sweep is of the radar with this band and array.
    ///
    /// # Errors
    /// Names the first number that differs.
    pub fn check_radar(&self, band: &Band, array: &Array) -> Result<(), SweepRefusal> {
        for (field, got, want) in [
            ("tx count", f64::from(self.tx_count), array.tx_m.len() as f64),
            ("rx count", f64::from(self.rx_count), array.rx_m.len() as f64),
            ("step count", self.band.step_count as f64, band.step_count as f64),
            ("start in Hz", self.band.start_hz, band.start_hz),
            ("step in Hz", self.band.step_hz, band.step_hz),
        ] {
            // A part in a thousand million: far below what a synthesiser holds.
            let same = (got - want).abs() <= 1e-9 * want.abs();
            if !same {
                return Err(SweepRefusal::OtherRadar { field, got, want });
            }
        }
        Ok(())
    }
}

/// `N` bytes from `at`; the callers stay within the fixed header.
fn part<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    let mut part = [0; N];
    part.copy_from_slice(&bytes[at..at + N]);
    part
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sweep() -> RawSweep {
        let band = Band { start_hz: 1.6e9, step_hz: 2e6, step_count: 2 };
        let samples = vec![Complex::new(1.0, -2.0), Complex::new(0.5, 0.0)];
        RawSweep { sequence: 7, taken_ns: 258, tx_count: 1, rx_count: 1, band, samples }
    }

    #[test]
    fn the_layout_is_the_documented_one() {
        // Written by the line of Python above, with the numbers of `sweep`.
        let want = "5453575001000000070000000000000002010000000000000100010002000000\
                    0000000084d7d7410000000080843e410000803f000000c00000003f00000000";
        let got: String = sweep().to_bytes().iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(got, want);
        assert_eq!(RawSweep::from_bytes(&sweep().to_bytes()), Ok(sweep()));
    }

    #[test]
    fn everything_else_is_refused_by_name() {
        let good = sweep().to_bytes();
        for length in 0..good.len() {
            assert!(RawSweep::from_bytes(&good[..length]).is_err(), "{length} bytes");
        }
        let label = |change: fn(&mut Vec<u8>)| {
            let mut bytes = good.clone();
            change(&mut bytes);
            RawSweep::from_bytes(&bytes).unwrap_err().label()
        };
        assert_eq!(label(Vec::clear), "too_short");
        assert_eq!(label(|bytes| bytes[0] = b'X'), "foreign");
        assert_eq!(label(|bytes| bytes[4] = 2), "version");
        assert_eq!(label(|bytes| bytes.push(0)), "length");
        assert_eq!(label(|bytes| bytes[24..32].fill(0xff)), "length");
        let other = Band { step_count: 3, ..sweep().band };
        let refusal = sweep().check_radar(&other, &Array::default()).unwrap_err();
        assert_eq!(refusal.label(), "other_radar");
        let single = Array { tx_m: vec![[0.0, 0.0]], rx_m: vec![[0.1, 0.0]] };
        assert_eq!(sweep().check_radar(&sweep().band, &single), Ok(()));
        let nan = RawSweep { band: Band { start_hz: f64::NAN, ..sweep().band }, ..sweep() };
        assert!(nan.check_radar(&sweep().band, &single).is_err());
    }
}
