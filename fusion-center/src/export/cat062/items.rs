//! The items of a CAT062 record, byte by byte.

use nalgebra::Matrix2;

use super::{Cat062Settings, GeoTrack, Origin};
use super::{Entry, Message, field_specification};
use crate::export::TrackStatus;

const SECONDS_PER_DAY: f64 = 86_400.0;
const FOOT_M: f64 = 0.3048;

/// Resolutions: of time, angle, place, velocity, altitude and age.
const TIME_LSB_S: f64 = 1.0 / 128.0;
const ANGLE_LSB_DEG: f64 = 180.0 / 33_554_432.0;
const PLACE_LSB_M: f64 = 0.5;
const VELOCITY_LSB_M_PER_S: f64 = 0.25;
const ALTITUDE_LSB_M: f64 = 6.25 * FOOT_M;
const AGE_LSB_S: f64 = 0.25;

/// What I062/130 can say, in its resolution: −1500 to 150,000 feet.
const ALTITUDES_LSB: (i64, i64) = (-240, 24_000);

/// An item under its field reference number.
pub(super) struct Item {
    pub(super) field: usize,
    pub(super) bytes: Vec<u8>,
}

/// The items of a record in the order of the user application profile.
pub(super) fn all(entry: &Entry<'_>, settings: &Cat062Settings) -> Vec<Item> {
    let track = entry.track;
    let items = [
        Some((1, vec![settings.sac, settings.sic])),
        Some((4, time_of_track(track))),
        Some((5, position(track))),
        cartesian(track, settings).map(|bytes| (6, bytes)),
        Some((7, velocity(track))),
        Some((12, entry.number.to_be_bytes().to_vec())),
        Some((13, status(entry, settings))),
        Some((14, ages(track))),
        Some((18, altitude(track))),
        Some((27, accuracies(track))),
    ];
    items.into_iter().flatten().map(|(field, bytes)| Item { field, bytes }).collect()
}

/// I062/070: since midnight UTC.
fn time_of_track(track: &GeoTrack) -> Vec<u8> {
    let of_day_s = track.time_unix_s.rem_euclid(SECONDS_PER_DAY);
    let ticks = steps(of_day_s, TIME_LSB_S);
    // The last 4 ms of a day round to its end, which is the start of the next.
    let day_ticks = steps(SECONDS_PER_DAY, TIME_LSB_S);
    be::<3>(if ticks < day_ticks { ticks } else { 0 })
}

/// I062/105: latitude, longitude in [−180, 180).
fn position(track: &GeoTrack) -> Vec<u8> {
    let lat = steps(track.position.lat_deg(), ANGLE_LSB_DEG);
    let lon = steps(track.position.lon_deg(), ANGLE_LSB_DEG);
    let turn = steps(360.0, ANGLE_LSB_DEG);
    [be::<4>(lat), be::<4>(if lon < turn / 2 { lon } else { lon - turn })].concat()
}

/// I062/100: east and north of the system's origin.
fn cartesian(track: &GeoTrack, settings: &Cat062Settings) -> Option<Vec<u8>> {
    let point = settings.frame?.to_enu(&track.position);
    let limits = signed_limits(24);
    let coordinate = |value_m: f64| be::<3>(within(steps(value_m, PLACE_LSB_M), limits));
    Some([coordinate(point.east_m), coordinate(point.north_m)].concat())
}

/// I062/185: towards true east and true north at the target.
fn velocity(track: &GeoTrack) -> Vec<u8> {
    let limits = signed_limits(16);
    let component = |value: f64| be::<2>(within(steps(value, VELOCITY_LSB_M_PER_S), limits));
    [component(track.velocity_m_per_s.x), component(track.velocity_m_per_s.y)].concat()
}

/// I062/080, six octets; every one but the last says in its lowest bit that another follows.
///
/// Bits of sensors that there are none of (SSR, Mode S, ADS-B) say "no update of late".
fn status(entry: &Entry<'_>, settings: &Cat062Settings) -> Vec<u8> {
    let flag = |is_set: bool, bit: u32| u8::from(is_set) << (bit - 1);
    let track = entry.track;
    let coasting = track.status == TrackStatus::Coasting;
    // Of the altitude (SRC): a 3-D radar where it was measured, a default where it was assumed.
    let altitude_source: u8 = if track.height_sigma_m.is_some() { 2 } else { 6 };
    let geometric_altitude = flag(true, 6);
    let non_cooperative = 2 << 6;
    let surface_target = flag(true, 5);
    vec![
        flag(track.sensors.len() < 2, 8)
            | geometric_altitude
            | altitude_source << 2
            | flag(track.status == TrackStatus::Tentative, 2)
            | 1,
        flag(settings.origin == Origin::Simulated, 8)
            | flag(entry.message == Message::Last, 7)
            | flag(entry.message == Message::First, 6)
            | 1,
        1,
        flag(coasting, 8) | flag(coasting, 7) | flag(true, 6) | flag(true, 5) | flag(true, 4) | 1,
        non_cooperative | 1,
        surface_target,
    ]
}

/// I062/290: subfields 1 (since the track began) and 2 (since its last primary plot).
fn ages(track: &GeoTrack) -> Vec<u8> {
    let age = |since_unix_s: f64| {
        be::<1>(within(steps(track.time_unix_s - since_unix_s, AGE_LSB_S), (0, 255)))
    };
    let subfields = [age(track.first_seen_unix_s), age(track.last_seen_unix_s)].concat();
    [field_specification([1, 2].into_iter()), subfields].concat()
}

/// I062/130: above the ellipsoid.
fn altitude(track: &GeoTrack) -> Vec<u8> {
    be::<2>(within(steps(track.position.height_m(), ALTITUDE_LSB_M), ALTITUDES_LSB))
}

/// I062/500: subfields 1 (standard deviations east and north), 2 (covariance), 4 (altitude) and
/// 6 (velocity). Largest values stand for all that are larger.
fn accuracies(track: &GeoTrack) -> Vec<u8> {
    let cov = &track.covariance_m2;
    let covariance_m = cov.m12.signum() * cov.m12.abs().sqrt();
    let [east, north] = deviations(cov, PLACE_LSB_M).map(|value| within(value, (0, 65_535)));
    let mut subfields = vec![
        (1, [be::<2>(east), be::<2>(north)].concat()),
        (2, be::<2>(within(steps(covariance_m, PLACE_LSB_M), signed_limits(16)))),
    ];
    if let Some(sigma_m) = track.height_sigma_m {
        subfields.push((4, be::<1>(within(steps(sigma_m, ALTITUDE_LSB_M), (0, 255)))));
    }
    if let Some(velocity) = &track.velocity_covariance_m2_per_s2 {
        let components = deviations(velocity, VELOCITY_LSB_M_PER_S);
        let bytes = components.map(|value| be::<1>(within(value, (0, 255))));
        subfields.push((6, bytes.concat()));
    }
    let present = field_specification(subfields.iter().map(|(field, _)| *field));
    [present, subfields.into_iter().flat_map(|(_, bytes)| bytes).collect()].concat()
}

fn deviations(covariance: &Matrix2<f64>, lsb: f64) -> [i64; 2] {
    [covariance.m11, covariance.m22].map(|variance| steps(variance.max(0.0).sqrt(), lsb))
}

/// The nearest whole number of steps.
#[expect(
    clippy::cast_possible_truncation,
    reason = "rounded to a whole number; what is beyond 64 bits is cut off there and then by its field"
)]
fn steps(value: f64, lsb: f64) -> i64 {
    (value / lsb).round() as i64
}

fn within(value: i64, (least, most): (i64, i64)) -> i64 {
    value.clamp(least, most)
}

fn signed_limits(bits: u32) -> (i64, i64) {
    let half = 1_i64 << (bits - 1);
    (-half, half - 1)
}

/// The lowest bytes, highest of them first; two's complement.
fn be<const BYTES: usize>(value: i64) -> Vec<u8> {
    value.to_be_bytes()[8 - BYTES..].to_vec()
}
