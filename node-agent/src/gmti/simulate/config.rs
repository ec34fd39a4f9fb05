//! Settings of a simulated wide-area radar: who is there, how it flies, looks and errs.

use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use super::scenes::{Layout, four_targets, load, three_targets};
use super::way::{Way, WayPoint};
use crate::imaging::{InvalidSetting, invalid};

/// Most targets: more than any scene of a wide-area radar.
const MAX_TARGET_COUNT: usize = 200_000;
/// Most steps of the beam in a scan.
const MAX_STEP_COUNT: f64 = 10_000.0;
/// Expected reports of a dwell beyond which a message could not hold them all.
const MAX_REPORTS_PER_DWELL: f64 = 3500.0;
/// Calendar times that make sense, seconds.
const TIMES_UNIX_S: RangeInclusive<f64> = 0.0..=7.2e9;

/// A scene that comes with the program.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// Two turn, one drives obliquely and pauses \[wide-area\].
    ThreeTargets,
    /// Two side by side, 50 m apart, and two that cross \[wide-area\].
    #[default]
    FourTargets,
    /// Many, anywhere, in any direction.
    LoadUniform,
    /// Many, in convoys of two lanes.
    LoadRoads,
}

/// A simulated radar and what it sees.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SimulatedGmtiConfig {
    /// Seed of everything random.
    pub seed: u64,
    /// Calendar time of the first dwell (Unix), seconds.
    pub start_unix_s: f64,
    /// Where the scene is.
    pub origin: OriginConfig,
    /// Which scene; the tables below take the place of its parts.
    pub preset: Preset,
    /// Turns the ways of the preset by 90 degrees to the left.
    pub rotated: bool,
    /// Targets of the `load` presets.
    pub target_count: usize,
    /// How the radar flies.
    pub platform: Option<PlatformConfig>,
    /// Where and when it looks.
    pub scan: Option<ScanConfig>,
    /// Errors of what it measures.
    pub noise: Option<NoiseConfig>,
    /// Which targets it sees.
    pub detection: Option<DetectionConfig>,
    /// Plots of nothing.
    pub clutter: Option<ClutterConfig>,
    /// Who is there, instead of the preset's, if any are listed.
    pub targets: Vec<TargetConfig>,
}

impl Default for SimulatedGmtiConfig {
    fn default() -> Self {
        Self {
            seed: 1,
            start_unix_s: 1.7e9,
            origin: OriginConfig::default(),
            preset: Preset::default(),
            rotated: false,
            target_count: 1000,
            platform: None,
            scan: None,
            noise: None,
            detection: None,
            clutter: None,
            targets: Vec::new(),
        }
    }
}

/// Where the local frame of a scene lies on the earth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OriginConfig {
    /// Degrees, north positive.
    pub lat_deg: f64,
    /// Degrees, east positive.
    pub lon_deg: f64,
    /// Height of all ground above the ellipsoid, metres.
    pub terrain_height_m: f64,
}

/// Near Hohhot, where \[wide-area\] flew.
impl Default for OriginConfig {
    fn default() -> Self {
        Self { lat_deg: 40.8, lon_deg: 111.7, terrain_height_m: 1050.0 }
    }
}

/// An aircraft that flies straight and level.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlatformConfig {
    /// At the first dwell, towards east from the origin, metres.
    pub east_m: f64,
    /// At the first dwell, towards north, metres.
    pub north_m: f64,
    /// Above the terrain, metres.
    pub height_m: f64,
    /// Direction in the local frame, degrees clockwise from north.
    pub course_deg: f64,
    /// Metres per second.
    pub speed_m_per_s: f64,
}

/// Where and when the radar looks: a sector about a place on the ground, again and again.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScanConfig {
    /// From scan to scan, seconds.
    pub period_s: f64,
    /// How many; without end if left out.
    #[serde(default)]
    pub count: Option<u32>,
    /// The place watched, towards east, metres.
    #[serde(default)]
    pub center_east_m: f64,
    /// The place watched, towards north, metres.
    #[serde(default)]
    pub center_north_m: f64,
    /// How far before and behind that place, metres over ground.
    pub range_half_extent_m: f64,
    /// How far to either side, as seen from the radar, degrees.
    pub angle_half_extent_deg: f64,
    /// How the beam steps through the sector; one look at all of it per scan if left out.
    #[serde(default)]
    pub beam: Option<BeamConfig>,
}

/// How a beam steps through the sector.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BeamConfig {
    /// What one dwell sees, degrees.
    pub width_deg: f64,
    /// From dwell to dwell, degrees; less than the width lets dwells overlap.
    pub step_deg: f64,
    /// How long a dwell takes, seconds.
    pub dwell_s: f64,
    /// Every other scan goes the other way.
    #[serde(default)]
    pub alternates: bool,
}

/// Errors of the measured place.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum PlaceNoise {
    /// Of slant range and cone angle, as a radar has them.
    Polar {
        /// Standard deviation of the slant range, metres.
        slant_sigma_m: f64,
        /// Standard deviation of the angle between flight and line of sight, degrees.
        cone_sigma_deg: f64,
    },
    /// Of the place on the ground, as \[wide-area\] states them.
    Ground {
        /// Variance along the line of sight over ground, square metres.
        along_m2: f64,
        /// Variance across it, square metres.
        across_m2: f64,
    },
}

/// Errors of what is measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoiseConfig {
    /// Of the place.
    pub place: PlaceNoise,
    /// Standard deviation of the radial velocity, metres per second; not measured if left out.
    #[serde(default)]
    pub radial_sigma_m_per_s: Option<f64>,
    /// Standard deviation of the strength, decibels; not measured if left out.
    #[serde(default)]
    pub strength_sigma_db: Option<f64>,
    /// Radial velocities are known up to multiples of this, metres per second.
    #[serde(default)]
    pub wrap_m_per_s: Option<f64>,
}

/// Which targets are seen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DetectionConfig {
    /// Of a target in the beam.
    pub probability: f64,
    /// Targets whose radial velocity is not above this are not seen, metres per second; those that
    /// stand never are.
    #[serde(default)]
    pub minimum_m_per_s: f64,
}

/// Plots of nothing, anywhere in a rectangle about the place watched.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClutterConfig {
    /// How many in the rectangle, on average, per scan (and in each dwell its share).
    pub per_scan: f64,
    /// Half of the rectangle, towards east, metres.
    pub east_half_m: f64,
    /// Half of the rectangle, towards north, metres.
    pub north_half_m: f64,
    /// Their radial velocities are anything up to this, metres per second.
    pub radial_half_m_per_s: f64,
    /// Their strength, decibels, give or take the noise's.
    pub strength_db: f64,
}

/// Somebody who drives.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TargetConfig {
    /// When it appears at the first point, seconds after the first dwell; it is gone after the last.
    #[serde(default)]
    pub from_s: f64,
    /// Its way.
    pub way: Vec<WayPoint>,
    /// Mean strength of its plots, decibels of power over noise.
    pub strength_db: f64,
}

/// A scene with nothing left to choose.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// How the radar flies.
    pub platform: PlatformConfig,
    /// Where and when it looks.
    pub scan: ScanConfig,
    /// Errors of what it measures.
    pub noise: NoiseConfig,
    /// Which targets it sees.
    pub detection: DetectionConfig,
    /// Plots of nothing.
    pub clutter: Option<ClutterConfig>,
    /// Who is there.
    pub targets: Vec<TargetConfig>,
}

impl SimulatedGmtiConfig {
    /// The preset, with what is stated here in its place.
    #[must_use]
    pub fn scene(&self) -> Scene {
        let mut scene = match self.preset {
            Preset::ThreeTargets => three_targets(),
            Preset::FourTargets => four_targets(),
            Preset::LoadUniform => load(Layout::Uniform, self.target_count, self.seed),
            Preset::LoadRoads => load(Layout::Roads, self.target_count, self.seed),
        };
        if self.rotated {
            scene.targets.iter_mut().flat_map(|target| &mut target.way).for_each(turn_left);
        }
        if !self.targets.is_empty() {
            scene.targets.clone_from(&self.targets);
        }
        scene.platform = self.platform.unwrap_or(scene.platform);
        scene.scan = self.scan.unwrap_or(scene.scan);
        scene.noise = self.noise.unwrap_or(scene.noise);
        scene.detection = self.detection.unwrap_or(scene.detection);
        scene.clutter = self.clutter.or(scene.clutter);
        scene
    }

    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense, from `simulated` on, and what would do.
    pub fn check(&self) -> Result<(), InvalidSetting> {
        within("start_unix_s", self.start_unix_s, TIMES_UNIX_S, "use seconds since 1970")?;
        let OriginConfig { lat_deg, lon_deg, terrain_height_m } = self.origin;
        within("origin.lat_deg", lat_deg, -90.0..=90.0, "use -90 to 90 degrees")?;
        within("origin.lon_deg", lon_deg, -180.0..=180.0, "use -180 to 180 degrees")?;
        let heights_m = -500.0..=9000.0;
        within("origin.terrain_height_m", terrain_height_m, heights_m, "use -500 to 9000 m")?;
        if MAX_TARGET_COUNT < self.target_count.max(self.targets.len()) {
            return Err(invalid("simulated.target_count", self.target_count, "use at most 200000"));
        }
        self.scene().check()
    }
}

impl Scene {
    /// Checks every field.
    ///
    /// # Errors
    /// See [`SimulatedGmtiConfig::check`].
    pub fn check(&self) -> Result<(), InvalidSetting> {
        self.platform.check()?;
        self.scan.check()?;
        self.noise.check()?;
        let DetectionConfig { probability, minimum_m_per_s } = self.detection;
        within("detection.probability", probability, 0.0..=1.0, "use 0 to 1")?;
        within("detection.minimum_m_per_s", minimum_m_per_s, 0.0..=1e3, "use 0 to 1000 m/s")?;
        self.clutter.map_or(Ok(()), |clutter| clutter.check())?;
        for (index, target) in self.targets.iter().enumerate() {
            let strength = format!("targets[{index}].strength_db");
            within(&strength, target.strength_db, -100.0..=200.0, "use -100 to 200 dB")?;
            let field = format!("simulated.targets[{index}].way");
            Way::new(&target.way, target.from_s, &field)?;
        }
        Ok(())
    }

    /// Whether every dwell is expected to fit in a message.
    ///
    /// # Errors
    /// Names what to change.
    pub fn check_message(&self) -> Result<(), InvalidSetting> {
        let step_count = f64::from(self.scan.step_count());
        let clutter = self.clutter.map_or(0.0, |clutter| clutter.per_scan);
        // Targets are nowhere three times as dense as on average over the beams of a real scene.
        let expected = 3.0 * (self.targets.len() as f64 + clutter) / step_count;
        let most = if step_count < 2.0 { expected / 3.0 } else { expected };
        let remedy = "use fewer targets, or [simulated.scan.beam] with more steps";
        let is_good = most <= MAX_REPORTS_PER_DWELL;
        is_good.then_some(()).ok_or_else(|| invalid("simulated.scan", most, remedy))
    }
}

impl PlatformConfig {
    fn check(&self) -> Result<(), InvalidSetting> {
        let Self { east_m, north_m, height_m, course_deg, speed_m_per_s } = *self;
        let places_m = -1e6..=1e6;
        within("platform.east_m", east_m, places_m.clone(), "use at most 1000 km")?;
        within("platform.north_m", north_m, places_m, "use at most 1000 km")?;
        within("platform.height_m", height_m, 10.0..=3e4, "use 10 m to 30 km")?;
        within("platform.course_deg", course_deg, -360.0..=360.0, "use degrees from north")?;
        within("platform.speed_m_per_s", speed_m_per_s, 1.0..=1e3, "use 1 to 1000 m/s")
    }
}

impl ScanConfig {
    /// Dwells per scan.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the check allows up to ten thousand; the cast saturates"
    )]
    pub fn step_count(&self) -> u32 {
        self.beam.map_or(1, |beam| self.steps(&beam).ceil().max(1.0) as u32)
    }

    fn steps(&self, beam: &BeamConfig) -> f64 {
        // Rounding must not add a beam.
        2.0 * self.angle_half_extent_deg / beam.step_deg - 1e-9
    }

    fn check(&self) -> Result<(), InvalidSetting> {
        let Self { period_s, range_half_extent_m, angle_half_extent_deg, .. } = *self;
        within("scan.period_s", period_s, 1e-3..=1e5, "use a positive number of seconds")?;
        let center = "use at most 1000 km";
        within("scan.center_east_m", self.center_east_m, -1e6..=1e6, center)?;
        within("scan.center_north_m", self.center_north_m, -1e6..=1e6, center)?;
        let extent = "use a positive number of metres";
        within("scan.range_half_extent_m", range_half_extent_m, 1.0..=1e6, extent)?;
        let half_deg = 1e-3..=180.0;
        within("scan.angle_half_extent_deg", angle_half_extent_deg, half_deg, "use up to 180")?;
        let Some(beam) = self.beam else { return Ok(()) };
        within("scan.beam.width_deg", beam.width_deg, 1e-3..=360.0, "use 0.001 to 360 degrees")?;
        within("scan.beam.step_deg", beam.step_deg, 1e-3..=360.0, "use 0.001 to 360 degrees")?;
        let count = self.steps(&beam);
        let most = "use larger steps: at most 10000 in a scan";
        within("scan.beam.step_deg", count, 0.0..=MAX_STEP_COUNT, most)?;
        let longest_s = period_s / f64::from(self.step_count()) * (1.0 + 1e-9);
        let remedy = "all dwells of a scan must fit in scan.period_s";
        within("scan.beam.dwell_s", beam.dwell_s, 0.0..=longest_s, remedy)
    }
}

impl NoiseConfig {
    fn check(&self) -> Result<(), InvalidSetting> {
        let remedy = "use a positive number";
        let positive = 1e-6..=1e6;
        match self.place {
            PlaceNoise::Polar { slant_sigma_m, cone_sigma_deg } => {
                let sigmas_m = positive.clone();
                within("noise.place.polar.slant_sigma_m", slant_sigma_m, sigmas_m, remedy)?;
                let angles_deg = 1e-9..=10.0;
                within("noise.place.polar.cone_sigma_deg", cone_sigma_deg, angles_deg, "up to 10")?;
            }
            PlaceNoise::Ground { along_m2, across_m2 } => {
                within("noise.place.ground.along_m2", along_m2, positive.clone(), remedy)?;
                within("noise.place.ground.across_m2", across_m2, positive.clone(), remedy)?;
            }
        }
        let others = [
            ("noise.radial_sigma_m_per_s", self.radial_sigma_m_per_s),
            ("noise.strength_sigma_db", self.strength_sigma_db),
            ("noise.wrap_m_per_s", self.wrap_m_per_s),
        ];
        let stated = others.into_iter().filter_map(|(field, value)| Some((field, value?)));
        stated
            .into_iter()
            .try_for_each(|(field, value)| within(field, value, positive.clone(), remedy))
    }
}

impl ClutterConfig {
    fn check(&self) -> Result<(), InvalidSetting> {
        let Self { per_scan, east_half_m, north_half_m, radial_half_m_per_s, strength_db } = *self;
        within("clutter.per_scan", per_scan, 0.0..=1e6, "use 0 to 1000000")?;
        let extent = "use a positive number of metres";
        within("clutter.east_half_m", east_half_m, 1.0..=1e6, extent)?;
        within("clutter.north_half_m", north_half_m, 1.0..=1e6, extent)?;
        let speeds = 1e-3..=1e3;
        within("clutter.radial_half_m_per_s", radial_half_m_per_s, speeds, "use up to 1000 m/s")?;
        within("clutter.strength_db", strength_db, -100.0..=200.0, "use -100 to 200 dB")
    }
}

fn turn_left(point: &mut WayPoint) {
    (point.east_m, point.north_m) = (-point.north_m, point.east_m);
}

/// Refuses what is not allowed; also what is no number.
fn within(
    field: &str,
    value: f64,
    allowed: RangeInclusive<f64>,
    remedy: &'static str,
) -> Result<(), InvalidSetting> {
    let is_good = allowed.contains(&value);
    is_good.then_some(()).ok_or_else(|| invalid(format!("simulated.{field}"), value, remedy))
}
