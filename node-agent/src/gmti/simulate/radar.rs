//! From a scene to the dwells of a radar that flies past it.

use nalgebra::{Vector2, Vector3};
use proto::geodesy::{EnuFrame, EnuPoint, GeoPosition, GeodesyError};
use proto::ids::NodeId;
use proto::wire::{Dwell, DwellArea, DwellReport, FlightRecord, GeoRecord};
use rand::rngs::ChaCha8Rng;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, Poisson, StandardNormal};
use thiserror::Error;

use super::config::{ClutterConfig, PlaceNoise, Scene, SimulatedGmtiConfig};
use super::geometry::{Carrier, Sight, wrapped};
use super::way::{Motion, Way};
use crate::imaging::InvalidSetting;

/// Stream of the seed from which detections and errors are drawn.
const NOISE_STREAM: u64 = 0x6e;
/// Over this time the course over ground is worked out, seconds: long enough for the rounding of
/// places, short enough that the earth is flat.
const COURSE_STEP_S: f64 = 1.0;

/// Why a scene cannot be simulated.
#[derive(Debug, Error)]
pub enum SimulationError {
    /// A setting makes no sense.
    #[error(transparent)]
    Setting(#[from] InvalidSetting),
    /// A place of the scene is none on the earth.
    #[error("simulating a wide-area radar: {0}")]
    Place(#[from] GeodesyError),
}

/// A target at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TruthState {
    /// Its place in the list of targets: its tag in reports.
    pub index: u32,
    /// In the local frame of the scene.
    pub motion: Motion,
}

/// A radar on its way past a scene: gives its dwells in the order of time.
#[derive(Debug)]
pub struct SimulatedGmti {
    node: NodeId,
    scene: Scene,
    ways: Vec<Way>,
    frame: EnuFrame,
    ground_height_m: f64,
    start_unix_s: f64,
    rng: ChaCha8Rng,
    scan_index: u32,
    step_index: u32,
}

/// Where and what one dwell sees, in the local frame.
#[derive(Clone, Copy, Debug)]
struct View {
    /// After the first dwell, seconds.
    time_s: f64,
    carrier: Carrier,
    /// Unit vector over ground to the middle of the beam.
    middle: Vector2<f64>,
    half_width_rad: f64,
    /// To the middle, over ground.
    range_m: f64,
    range_half_extent_m: f64,
}

/// What was measured, in the local frame.
#[derive(Clone, Copy, Debug)]
struct Measured {
    place_m: Vector2<f64>,
    radial_m_per_s: f64,
    strength_db: f64,
    truth: Option<u32>,
}

impl View {
    fn sees(&self, place_m: &Vector2<f64>) -> bool {
        let line_m = place_m - self.carrier.position_m.xy();
        let off_rad = self.middle.perp(&line_m).atan2(self.middle.dot(&line_m));
        let far_m = line_m.norm() - self.range_m;
        off_rad.abs() <= self.half_width_rad && far_m.abs() <= self.range_half_extent_m
    }
}

impl SimulatedGmti {
    /// A radar before its first dwell.
    ///
    /// # Errors
    /// If a setting makes no sense.
    pub fn new(config: &SimulatedGmtiConfig, node: NodeId) -> Result<Self, SimulationError> {
        config.check()?;
        let scene = config.scene();
        let way = |target: &super::TargetConfig| Way::new(&target.way, target.from_s, "way");
        let ways = scene.targets.iter().map(way).collect::<Result<_, InvalidSetting>>()?;
        let ground_height_m = config.origin.terrain_height_m;
        let (lat_deg, lon_deg) = (config.origin.lat_deg, config.origin.lon_deg);
        let frame = EnuFrame::new(GeoPosition::new(lat_deg, lon_deg, ground_height_m)?);
        let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
        rng.set_stream(NOISE_STREAM);
        Ok(Self {
            node,
            scene,
            ways,
            frame,
            ground_height_m,
            start_unix_s: config.start_unix_s,
            rng,
            scan_index: 0,
            step_index: 0,
        })
    }

    /// The scene.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The local frame: its origin is the scene's, on the ground.
    #[must_use]
    pub fn frame(&self) -> &EnuFrame {
        &self.frame
    }

    /// Everybody who is there at a calendar time (Unix), seconds.
    #[must_use]
    pub fn truths(&self, time_unix_s: f64) -> Vec<TruthState> {
        let time_s = time_unix_s - self.start_unix_s;
        let there = (0_u32..).zip(&self.ways);
        there
            .filter_map(|(index, way)| Some(TruthState { index, motion: way.at(time_s)? }))
            .collect()
    }

    /// Where a target is at a calendar time (Unix), seconds, if it is there.
    #[must_use]
    pub fn truth(&self, index: u32, time_unix_s: f64) -> Option<Motion> {
        self.ways.get(usize::try_from(index).ok()?)?.at(time_unix_s - self.start_unix_s)
    }

    /// The next dwell; `None` after the last scan.
    ///
    /// # Errors
    /// If the aircraft or a plot leaves the earth.
    pub fn next_dwell(&mut self) -> Result<Option<Dwell>, GeodesyError> {
        if self.scene.scan.count.is_some_and(|count| count <= self.scan_index) {
            return Ok(None);
        }
        let (scan_index, step_index) = (self.scan_index, self.step_index);
        let step_count = self.scene.scan.step_count();
        let view = self.view(scan_index, step_index)?;
        let plots = self.plots(&view)?;
        let dwell = Dwell {
            node: self.node.clone(),
            time_unix_s: self.start_unix_s + view.time_s,
            revisit_index: scan_index,
            dwell_index: step_index,
            is_last_of_revisit: step_index + 1 == step_count,
            sensor: record(&self.frame.to_geo(&EnuPoint::from(view.carrier.position_m))?),
            flight: Some(self.flight(&view.carrier)?),
            area: self.area(&view)?,
            minimum_detectable_m_per_s: Some(self.scene.detection.minimum_m_per_s)
                .filter(|least| 0.0 < *least),
            detection_probability: Some(self.scene.detection.probability),
            is_simulated: true,
            reports: self.reports(&view, &plots)?,
        };
        self.step_index = (step_index + 1) % step_count;
        self.scan_index += u32::from(self.step_index == 0);
        Ok(Some(dwell))
    }

    /// Where the aircraft is: straight over the plane, at constant height above the ellipsoid.
    fn carrier(&self, time_s: f64) -> Result<Carrier, GeodesyError> {
        let platform = &self.scene.platform;
        let (sin_course, cos_course) = platform.course_deg.to_radians().sin_cos();
        let flown_m = platform.speed_m_per_s * time_s;
        let (east_m, north_m) =
            (platform.east_m + flown_m * sin_course, platform.north_m + flown_m * cos_course);
        let height_m = self.ground_height_m + platform.height_m;
        Ok(Carrier {
            position_m: self.in_frame(&Vector2::new(east_m, north_m), height_m)?,
            direction_rad: cos_course.atan2(sin_course),
            speed_m_per_s: platform.speed_m_per_s,
        })
    }

    /// The point over a place of the plane that has this height above the ellipsoid.
    fn in_frame(
        &self,
        place_m: &Vector2<f64>,
        height_m: f64,
    ) -> Result<Vector3<f64>, GeodesyError> {
        let EnuPoint { up_m, .. } =
            self.frame.to_enu(&self.frame.on_surface(place_m.x, place_m.y, height_m)?);
        Ok(place_m.push(up_m))
    }

    fn view(&self, scan_index: u32, step_index: u32) -> Result<View, GeodesyError> {
        let scan = &self.scene.scan;
        let beam = scan.beam.as_ref();
        let dwell_s = beam.map_or(0.0, |beam| beam.dwell_s);
        let time_s = f64::from(scan_index) * scan.period_s + f64::from(step_index) * dwell_s;
        let last = f64::from(scan.step_count() - 1);
        let turns_back = beam.is_some_and(|beam| beam.alternates) && scan_index % 2 == 1;
        let place = f64::from(step_index) - 0.5 * last;
        let step_deg = beam.map_or(0.0, |beam| beam.step_deg);
        let offset_deg = if turns_back { -place } else { place } * step_deg;
        let half_deg = beam.map_or(scan.angle_half_extent_deg, |beam| 0.5 * beam.width_deg);
        let carrier = self.carrier(time_s)?;
        let center_m = Vector2::new(scan.center_east_m, scan.center_north_m);
        let line_m = center_m - carrier.position_m.xy();
        let direction_rad = line_m.y.atan2(line_m.x) + offset_deg.to_radians();
        Ok(View {
            time_s,
            carrier,
            middle: Vector2::new(direction_rad.cos(), direction_rad.sin()),
            half_width_rad: half_deg.to_radians(),
            range_m: line_m.norm(),
            range_half_extent_m: scan.range_half_extent_m,
        })
    }

    /// What is measured in a dwell, in no order.
    fn plots(&mut self, view: &View) -> Result<Vec<Measured>, GeodesyError> {
        let mut plots = Vec::new();
        for index in 0..self.ways.len() {
            let seen = self.ways[index].at(view.time_s);
            let Some(motion) = seen.filter(|motion| view.sees(&motion.position_m)) else {
                continue;
            };
            let strength_db = self.scene.targets[index].strength_db;
            if let Some(plot) = self.measure(view, &motion, strength_db)? {
                plots.push(Measured { truth: u32::try_from(index).ok(), ..plot });
            }
        }
        if let Some(clutter) = self.scene.clutter {
            self.add_clutter(view, &clutter, &mut plots);
        }
        plots.shuffle(&mut self.rng);
        Ok(plots)
    }

    /// What is measured of one target, if it is seen. As many numbers are drawn in any case, so that
    /// settings change nobody else's errors.
    fn measure(
        &mut self,
        view: &View,
        motion: &Motion,
        strength_db: f64,
    ) -> Result<Option<Measured>, GeodesyError> {
        let chance: f64 = self.rng.random();
        let errors: [f64; 4] = std::array::from_fn(|_| StandardNormal.sample(&mut self.rng));
        let place_m = self.in_frame(&motion.position_m, self.ground_height_m)?;
        let Some(sight) = view.carrier.sight(&place_m) else { return Ok(None) };
        let radial_m_per_s = sight.direction.xy().dot(&motion.velocity_m_per_s);
        let detection = &self.scene.detection;
        let is_seen =
            detection.minimum_m_per_s < radial_m_per_s.abs() && chance < detection.probability;
        let found_m = is_seen.then(|| self.place_found(view, &sight, &place_m, &errors)).flatten();
        let noise = &self.scene.noise;
        let or_zero = |sigma: Option<f64>| sigma.unwrap_or(0.0);
        Ok(found_m.map(|found_m| Measured {
            place_m: found_m,
            radial_m_per_s: radial_m_per_s + or_zero(noise.radial_sigma_m_per_s) * errors[2],
            strength_db: strength_db + or_zero(noise.strength_sigma_db) * errors[3],
            truth: None,
        }))
    }

    /// The place with its errors; `None` where the measured range does not reach the ground.
    fn place_found(
        &self,
        view: &View,
        sight: &Sight,
        place_m: &Vector3<f64>,
        errors: &[f64; 4],
    ) -> Option<Vector2<f64>> {
        match self.scene.noise.place {
            PlaceNoise::Polar { slant_sigma_m, cone_sigma_deg } => {
                let slant_m = sight.slant_m + slant_sigma_m * errors[0];
                let cone_rad = sight.cone_rad + cone_sigma_deg.to_radians() * errors[1];
                view.carrier.place(&Sight { slant_m, cone_rad, ..*sight }, place_m.z)
            }
            PlaceNoise::Ground { along_m2, across_m2 } => {
                let along = sight.direction.xy().try_normalize(f64::MIN_POSITIVE)?;
                let across = Vector2::new(-along.y, along.x);
                let error_m =
                    along * along_m2.sqrt() * errors[0] + across * across_m2.sqrt() * errors[1];
                Some(place_m.xy() + error_m)
            }
        }
    }

    fn add_clutter(&mut self, view: &View, clutter: &ClutterConfig, plots: &mut Vec<Measured>) {
        // The mean may be 0, of which the library makes no distribution.
        let Ok(counts) = Poisson::new(clutter.per_scan) else { return };
        let drawn: f64 = counts.sample(&mut self.rng);
        let scan = &self.scene.scan;
        let center_m = Vector2::new(scan.center_east_m, scan.center_north_m);
        let sigma_db = self.scene.noise.strength_sigma_db.unwrap_or(0.0);
        let mut left = drawn;
        while 0.0 < left {
            left -= 1.0;
            let [east, north, radial] = std::array::from_fn(|_| self.rng.random_range(-1.0..1.0));
            let deviation: f64 = StandardNormal.sample(&mut self.rng);
            let off_m = Vector2::new(east * clutter.east_half_m, north * clutter.north_half_m);
            let place_m = center_m + off_m;
            if view.sees(&place_m) {
                plots.push(Measured {
                    place_m,
                    radial_m_per_s: radial * clutter.radial_half_m_per_s,
                    strength_db: clutter.strength_db + sigma_db * deviation,
                    truth: None,
                });
            }
        }
    }

    fn reports(&self, view: &View, plots: &[Measured]) -> Result<Vec<DwellReport>, GeodesyError> {
        (0..).zip(plots).map(|(index, plot)| self.report(view, index, plot)).collect()
    }

    /// A plot as it is reported: standard deviations as a radar would state them, at the place that
    /// it measured.
    fn report(
        &self,
        view: &View,
        index: u32,
        plot: &Measured,
    ) -> Result<DwellReport, GeodesyError> {
        let noise = &self.scene.noise;
        let place = self.frame.on_surface(plot.place_m.x, plot.place_m.y, self.ground_height_m)?;
        let place_m = plot.place_m.push(self.frame.to_enu(&place).up_m);
        let line_m = place_m - view.carrier.position_m;
        let (slant_sigma_m, cross_sigma_m) = match noise.place {
            PlaceNoise::Polar { slant_sigma_m, cone_sigma_deg } => {
                let per_rad = view.carrier.cross_m_per_rad(&place_m);
                (slant_sigma_m, per_rad.map(|per_rad| per_rad * cone_sigma_deg.to_radians()))
            }
            PlaceNoise::Ground { along_m2, across_m2 } => {
                let cos_grazing = line_m.xy().norm() / line_m.norm();
                (along_m2.sqrt() * cos_grazing, Some(across_m2.sqrt()))
            }
        };
        let wrap = |radial: f64| noise.wrap_m_per_s.map_or(radial, |span| wrapped(radial, span));
        Ok(DwellReport {
            index,
            place: record(&place),
            slant_sigma_m: Some(slant_sigma_m),
            cross_sigma_m,
            radial_m_per_s: noise.radial_sigma_m_per_s.map(|_| wrap(plot.radial_m_per_s)),
            radial_sigma_m_per_s: noise.radial_sigma_m_per_s,
            wrap_m_per_s: noise.radial_sigma_m_per_s.and(noise.wrap_m_per_s),
            snr_db: noise.strength_sigma_db.map(|_| plot.strength_db),
            truth: plot.truth,
        })
    }

    fn area(&self, view: &View) -> Result<DwellArea, GeodesyError> {
        let center_m = view.carrier.position_m.xy() + view.middle * view.range_m;
        let center = self.frame.on_surface(center_m.x, center_m.y, self.ground_height_m)?;
        Ok(DwellArea {
            center: record(&center),
            range_half_extent_m: view.range_half_extent_m,
            angle_half_extent_deg: view.half_width_rad.to_degrees(),
        })
    }

    /// How it flies, towards the true north of where it is.
    fn flight(&self, carrier: &Carrier) -> Result<FlightRecord, GeodesyError> {
        let here = self.frame.to_geo(&EnuPoint::from(carrier.position_m))?;
        let on_m = carrier.position_m + carrier.velocity_m_per_s() * COURSE_STEP_S;
        let step = EnuFrame::new(here).to_enu(&self.frame.to_geo(&EnuPoint::from(on_m))?);
        Ok(FlightRecord {
            course_deg: step.east_m.atan2(step.north_m).to_degrees().rem_euclid(360.0),
            speed_m_per_s: carrier.speed_m_per_s,
            climb_m_per_s: 0.0,
        })
    }
}

fn record(place: &GeoPosition) -> GeoRecord {
    GeoRecord { lat_deg: place.lat_deg(), lon_deg: place.lon_deg(), height_m: place.height_m() }
}
