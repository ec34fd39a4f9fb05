//! What the wall's own echoes tell about it: stand-off, thickness and permittivity, or why not.
//!
//! The static part of the sweeps (their mean over some seconds) holds the reflections of the wall's
//! front and back face. Over the lateral distances of the array's channels their delays follow
//! different curves (a common-midpoint measurement), which separates `d` from `ε`; the difference
//! of the delays alone gives only `o = d sqrt ε`. What matters to an image is the excess path
//! `E = d (sqrt ε − 1) = o (1 − 1/sqrt ε)`.
//!
//! Steps: a gate over delay (`gate`), a search over stand-off and optical thickness, a fit from the
//! best places (`fit`), tests that both faces stand out, and the error of `E`. Of all slabs that
//! explain the samples, one whose multiple is stronger than its back face is refused: half the
//! thickness explains every pair of faces so.
//!
//! Assumes one homogeneous slab parallel to the array, nothing else that is static within the gate,
//! and channels calibrated in delay. Only delays are used, no phases between channels. Far from the
//! array (`s` above some 0.3 m at 40 dB) the curves differ by less than the noise; the outcome is
//! then an assumption, corrected by the optical thickness that was measured.
//! Cost: some 400 projections for the search, some 200 for the fits.

use nalgebra::{Matrix3, Vector3};
use rustfft::num_complex::Complex;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use proto::radar::{Array, Band, SPEED_OF_LIGHT_M_PER_S, Wall};

use super::wall::excess_path_m;
use super::{InvalidSetting, invalid};

use fit::{Fit, MIN_OPTICAL_THICKNESS_M, PERMITTIVITY_RANGE, Samples, Slab, wall_of};
use gate::Gate;

mod fit;
mod gate;

/// Path that the gate reaches beyond the faces, metres: two resolution cells of
/// 600 MHz, so that an echo at the array passes nearly whole.
const GATE_MARGIN_M: f64 = 1.0;
/// Step of the search in stand-off and optical thickness, metres: a quarter of a range cell.
const SEARCH_STEP_M: f64 = 0.06;
/// The permittivity of the search; it moves delays by less than a cell.
const SEARCH_PERMITTIVITY: f64 = 4.5;
/// Fits start from this many places ...
const START_COUNT: usize = 4;
/// ... at least this far apart, metres.
const START_DISTANCE_M: f64 = 0.13;
/// Nearer than this to a bound of the search, metres, a fit has ended on it.
const BOUND_MARGIN_M: f64 = 1e-4;
/// A face must stand out by this in each channel on the average, decibels of power. What noise
/// alone offers to the search stays below 10 dB; what is no pair of parallel faces leaves a residual
/// about 20 dB below them.
const MIN_FACE_SNR_DB: f64 = 20.0;

/// What is known of the leakage from transmitter to receiver.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DirectCoupling {
    /// It was measured without a wall and subtracted.
    #[default]
    Removed,
    /// It is in the samples at its known delay, with unknown amplitudes. A front face nearer than a
    /// range cell can then not be told from it.
    Present,
}

/// What is assumed of a wall that cannot be measured, each ± its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WallPrior {
    /// Thickness, metres.
    pub thickness_m: f64,
    /// Its standard deviation.
    pub thickness_sigma_m: f64,
    /// Relative permittivity.
    pub permittivity: f64,
    /// Its standard deviation.
    pub permittivity_sigma: f64,
}

impl Default for WallPrior {
    /// A brick wall of 0.24 m.
    fn default() -> Self {
        Self {
            thickness_m: 0.24,
            thickness_sigma_m: 0.06,
            permittivity: 5.0,
            permittivity_sigma: 1.0,
        }
    }
}

/// Where the faces are looked for, and what counts as an answer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WallSearch {
    /// Largest stand-off of the front face, metres.
    pub max_standoff_m: f64,
    /// Largest optical thickness `d sqrt ε`, metres.
    pub max_optical_thickness_m: f64,
    /// An excess path with a larger standard deviation, metres, is no answer; an assumed
    /// permittivity gives 0.025.
    pub max_excess_sigma_m: f64,
    /// The leakage between the antennas.
    pub direct: DirectCoupling,
    /// What is said of the wall otherwise.
    pub prior: WallPrior,
}

impl Default for WallSearch {
    fn default() -> Self {
        Self {
            max_standoff_m: 1.2,
            max_optical_thickness_m: 1.2,
            max_excess_sigma_m: 0.025,
            direct: DirectCoupling::default(),
            prior: WallPrior::default(),
        }
    }
}

impl WallSearch {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), InvalidSetting> {
        let prior = &self.prior;
        for (field, value, range) in [
            ("max_standoff_m", self.max_standoff_m, 0.05..=10.0),
            ("max_optical_thickness_m", self.max_optical_thickness_m, 0.2..=10.0),
            ("max_excess_sigma_m", self.max_excess_sigma_m, 1e-6..=1.0),
            ("prior.thickness_m", prior.thickness_m, 0.001..=5.0),
            ("prior.thickness_sigma_m", prior.thickness_sigma_m, 1e-6..=5.0),
            ("prior.permittivity", prior.permittivity, 1.0..=100.0),
            ("prior.permittivity_sigma", prior.permittivity_sigma, 1e-6..=100.0),
        ] {
            if !range.contains(&value) {
                let field = format!("wall_search.{field}");
                return Err(invalid(field, value, "use a positive number of usual size"));
            }
        }
        Ok(())
    }
}

/// A wall as its echoes tell it.
#[derive(Clone, Debug, PartialEq)]
pub struct EstimatedWall {
    /// Air between the array and the front face, metres.
    pub standoff_m: f64,
    /// Thickness and permittivity.
    pub wall: Wall,
    /// `d sqrt ε`, metres: what the difference of the faces' delays gives.
    pub optical_thickness_m: f64,
    /// Covariance of `[standoff_m, optical_thickness_m, permittivity]`. Thickness and permittivity
    /// themselves follow a curve, along which no covariance would tell how well `d sqrt ε` is known.
    pub covariance: Matrix3<f64>,
    /// Standard deviation of the thickness, metres.
    pub thickness_sigma_m: f64,
    /// `d (sqrt ε − 1)`, metres.
    pub excess_path_m: f64,
    /// Its standard deviation.
    pub excess_path_sigma_m: f64,
    /// How far front and back face stand out of what no slab explains, decibels of power.
    pub face_snr_db: [f64; 2],
}

/// A wall that is not measured but assumed.
#[derive(Clone, Debug, PartialEq)]
pub struct AssumedWall {
    /// Thickness and permittivity.
    pub wall: Wall,
    /// `d (sqrt ε − 1)`, metres.
    pub excess_path_m: f64,
    /// Its standard deviation.
    pub excess_path_sigma_m: f64,
}

/// Why the echoes do not tell the wall.
#[derive(Clone, Debug, PartialEq)]
pub enum WhyNot {
    /// No two faces stand out that a slab explains: there is no wall, it has no back face that
    /// shows, or something else lies within the gate.
    NoFaces {
        /// How far the best front and back face stand out, decibels of power.
        face_snr_db: [f64; 2],
    },
    /// Faces are seen, but the array is too small for their distance: thickness and permittivity
    /// cannot be told apart. The assumption has the optical thickness that was measured. Two strong
    /// things one behind the other, without a wall, can end here too.
    OffsetsTooSmall {
        /// Air between the array and the front face, metres.
        standoff_m: f64,
        /// Standard deviation of the excess path from the echoes alone, metres.
        excess_path_sigma_m: f64,
    },
}

/// What the echoes tell.
#[derive(Clone, Debug, PartialEq)]
pub enum WallOutcome {
    /// The wall, with its errors.
    Estimated(EstimatedWall),
    /// Not enough; what is assumed instead.
    NotObservable {
        /// Why.
        why: WhyNot,
        /// What is assumed.
        assumed: AssumedWall,
    },
}

/// Why samples were refused.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum WallEstimateError {
    /// The samples are not from this radar.
    #[error("estimating the wall: {got} samples, the radar has {want}")]
    SampleCount {
        /// Samples given.
        got: usize,
        /// Channels times frequencies.
        want: usize,
    },
    /// A sample is no number.
    #[error("estimating the wall: sample {index} is not finite")]
    NotFinite {
        /// Where, counted over all channels.
        index: usize,
    },
}

/// Estimates walls for one radar.
#[derive(Clone, Debug)]
pub struct WallEstimator {
    array: Array,
    step_count: usize,
    search: WallSearch,
    gate: Gate,
}

impl WallEstimator {
    /// Prepares the gate for `search`.
    ///
    /// # Errors
    /// Names the first setting that makes no sense.
    pub fn new(band: &Band, array: &Array, search: &WallSearch) -> Result<Self, InvalidSetting> {
        band.check()?;
        array.check()?;
        search.check()?;
        let far_m = 2.0 * (search.max_standoff_m + search.max_optical_thickness_m) + GATE_MARGIN_M;
        let far_s = far_m / SPEED_OF_LIGHT_M_PER_S;
        if 1.0 / band.step_hz < far_s {
            let remedy = "let the faces lie within the radar's unambiguous range c / (2 step)";
            return Err(invalid("wall_search.max_standoff_m", search.max_standoff_m, remedy));
        }
        let gate = Gate::new(band, -GATE_MARGIN_M / SPEED_OF_LIGHT_M_PER_S, far_s);
        let (array, step_count) = (array.clone(), band.step_count);
        Ok(Self { array, step_count, search: *search, gate })
    }

    /// What `background`, the mean of raw sweeps `[channel][frequency]`, tells of the wall.
    ///
    /// # Errors
    /// If the samples are not as many as the radar has, or one is no number.
    pub fn estimate(&self, background: &[Complex<f32>]) -> Result<WallOutcome, WallEstimateError> {
        let (got, want) = (background.len(), self.array.channel_count() * self.step_count);
        if got != want {
            return Err(WallEstimateError::SampleCount { got, want });
        }
        if let Some(index) = background.iter().position(|sample| !sample.is_finite()) {
            return Err(WallEstimateError::NotFinite { index });
        }
        let samples = Samples::new(&self.gate, &self.array, self.search.direct, background);
        let starts = self.starts(&samples);
        let fits = starts.iter().filter_map(|start| samples.fit(start, &self.bounds()));
        let best = fits
            .filter(|fit| fit.snr[2] < fit.snr[1] && self.is_inside(&fit.slab))
            .min_by(|a, b| a.residual_power.total_cmp(&b.residual_power));
        Ok(self.outcome(samples, best.as_ref()))
    }

    fn bounds(&self) -> [Slab; 2] {
        let WallSearch { max_standoff_m, max_optical_thickness_m, .. } = self.search;
        let [least, largest] = PERMITTIVITY_RANGE;
        [
            Slab::new(0.0, MIN_OPTICAL_THICKNESS_M, least),
            Slab::new(max_standoff_m, max_optical_thickness_m, largest),
        ]
    }

    /// Whether a fit ended off the bounds of stand-off and optical thickness; one that ends there was
    /// driven out by something that is no slab.
    fn is_inside(&self, slab: &Slab) -> bool {
        let [least, largest] = self.bounds();
        let room_m = (slab - least).inf(&(largest - slab));
        BOUND_MARGIN_M < room_m.x && BOUND_MARGIN_M < room_m.y
    }

    /// The places of a coarse search that leave least, none near a better one.
    fn starts(&self, samples: &Samples<'_>) -> Vec<Slab> {
        let [least, largest] = self.bounds();
        let steps = |from_m: f64, to_m: f64| {
            let inner = (1..).map(move |step| from_m + SEARCH_STEP_M * f64::from(step));
            inner.take_while(move |at_m| *at_m < to_m)
        };
        let mut places: Vec<(f64, Slab)> = steps(least.x, largest.x)
            .flat_map(|s| {
                steps(least.y, largest.y).map(move |o| Slab::new(s, o, SEARCH_PERMITTIVITY))
            })
            .map(|slab| (samples.residual_power(&slab), slab))
            .collect();
        places.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut starts: Vec<Slab> = Vec::new();
        for (_, place) in places {
            if starts.iter().all(|start| START_DISTANCE_M < (start - place).norm()) {
                starts.push(place);
            }
            if starts.len() == START_COUNT {
                break;
            }
        }
        starts
    }

    fn outcome(&self, samples: Samples<'_>, best: Option<&Fit>) -> WallOutcome {
        let Some(fit) = best else {
            return self.no_faces([f64::NEG_INFINITY; 2]);
        };
        let face_snr_db = [0, 1].map(|face| 10.0 * fit.snr[face].max(f64::MIN_POSITIVE).log10());
        if face_snr_db.iter().any(|db| *db < MIN_FACE_SNR_DB) {
            return self.no_faces(face_snr_db);
        }
        let excess_path_sigma_m = excess_sigma_m(&fit.slab, &fit.covariance);
        if self.search.max_excess_sigma_m < excess_path_sigma_m {
            let standoff_m = fit.slab.x;
            let why = WhyNot::OffsetsTooSmall { standoff_m, excess_path_sigma_m };
            let assumed = self.assumed_with(samples, fit);
            return WallOutcome::NotObservable { why, assumed };
        }
        let wall = wall_of(&fit.slab);
        WallOutcome::Estimated(EstimatedWall {
            standoff_m: fit.slab.x,
            wall,
            optical_thickness_m: fit.slab.y,
            covariance: fit.covariance,
            thickness_sigma_m: thickness_sigma_m(&fit.slab, &fit.covariance),
            excess_path_m: excess_path_m(&wall),
            excess_path_sigma_m,
            face_snr_db,
        })
    }

    fn no_faces(&self, face_snr_db: [f64; 2]) -> WallOutcome {
        let why = WhyNot::NoFaces { face_snr_db };
        WallOutcome::NotObservable { why, assumed: self.assumed() }
    }

    /// The prior alone.
    fn assumed(&self) -> AssumedWall {
        let WallPrior { thickness_m, thickness_sigma_m, permittivity, permittivity_sigma } =
            self.search.prior;
        let wall = Wall { thickness_m, permittivity };
        let by_thickness_m = (permittivity.sqrt() - 1.0) * thickness_sigma_m;
        let by_permittivity_m = 0.5 * thickness_m / permittivity.sqrt() * permittivity_sigma;
        AssumedWall {
            wall,
            excess_path_m: excess_path_m(&wall),
            excess_path_sigma_m: by_thickness_m.hypot(by_permittivity_m),
        }
    }

    /// The fit repeated with the prior's permittivity as one measurement more.
    fn assumed_with(&self, samples: Samples<'_>, fit: &Fit) -> AssumedWall {
        let WallPrior { permittivity, permittivity_sigma, .. } = self.search.prior;
        let start = Slab::new(fit.slab.x, fit.slab.y, permittivity);
        let pulled = samples.with_permittivity(fit, permittivity, permittivity_sigma);
        let Some(refit) = pulled.fit(&start, &self.bounds()) else { return self.assumed() };
        let wall = wall_of(&refit.slab);
        AssumedWall {
            wall,
            excess_path_m: excess_path_m(&wall),
            excess_path_sigma_m: excess_sigma_m(&refit.slab, &refit.covariance),
        }
    }
}

/// Standard deviation of `E = o (1 − 1/sqrt ε)`, metres.
fn excess_sigma_m(slab: &Slab, covariance: &Matrix3<f64>) -> f64 {
    let root = slab.z.sqrt();
    let gradient = Vector3::new(0.0, 1.0 - 1.0 / root, 0.5 * slab.y / (slab.z * root));
    gradient.dot(&(covariance * gradient)).max(0.0).sqrt()
}

/// Standard deviation of `d = o / sqrt ε`, metres.
fn thickness_sigma_m(slab: &Slab, covariance: &Matrix3<f64>) -> f64 {
    let root = slab.z.sqrt();
    let gradient = Vector3::new(0.0, 1.0 / root, -0.5 * slab.y / (slab.z * root));
    gradient.dot(&(covariance * gradient)).max(0.0).sqrt()
}

#[cfg(test)]
mod tests;
