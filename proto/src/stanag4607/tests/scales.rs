//! The scaled numbers at the limits of their fields, and times over midnight.

use super::super::{
    B16, Ba16, Ba32, Mission, MissionClock, NoSuchDate, OutOfRange, Sa16, Sa32, TargetReport,
    TargetSigmas, Text, TextError,
};
use super::dwell;

/// One step of each kind of angle, degrees, from the definition.
const BA16_STEP_DEG: f64 = 360.0 / 65_536.0;
const BA32_STEP_DEG: f64 = 360.0 / 4_294_967_296.0;
const SA16_STEP_DEG: f64 = 180.0 / 65_536.0;
const SA32_STEP_DEG: f64 = 180.0 / 4_294_967_296.0;
/// Powers of two times a full turn are exact but for the last bit.
const EXACT: f64 = 1e-12;

fn same(found: f64, expected: f64) {
    assert!((found - expected).abs() < EXACT, "{found} instead of {expected}");
}

#[test]
fn angles_at_their_limits() {
    same(Ba16(0xffff).deg(), 360.0 - BA16_STEP_DEG);
    same(Ba32(0xffff_ffff).deg(), 360.0 - BA32_STEP_DEG);
    same(Ba32(0xffff_ffff).signed_deg(), -BA32_STEP_DEG);
    same(Ba32(0x7fff_ffff).signed_deg(), 180.0 - BA32_STEP_DEG);
    same(Ba32(0x8000_0000).signed_deg(), -180.0);
    same(Sa16(i16::MAX).deg(), 90.0 - SA16_STEP_DEG);
    same(Sa16(i16::MIN).deg(), -90.0);
    same(Sa32(i32::MAX).deg(), 90.0 - SA32_STEP_DEG);
    same(Sa32(i32::MIN).deg(), -90.0);
    same(Sa32(i32::MIN).rad(), -std::f64::consts::FRAC_PI_2);
    // The two examples of the standard's annex C.
    same(Ba16(0b0101_1001_0001_1100).deg(), 125.310_058_593_75);
    same(Sa16(0b1100_1110_0110_0110_u16.cast_signed()).deg(), -34.876_098_632_812_5);
}

#[test]
fn angles_are_rounded_to_the_nearest_step() {
    for (deg, raw) in [(0.4, 0), (0.6, 1), (-0.6, 0xffff), (-0.4, 0), (65_535.6, 0)] {
        assert_eq!(Ba16::from_deg(deg * BA16_STEP_DEG), Ok(Ba16(raw)), "{deg} steps");
    }
    for (deg, raw) in [(0.4, 0), (0.6, 1), (-0.6, u32::MAX), (4_294_967_295.6, 0)] {
        assert_eq!(Ba32::from_deg(deg * BA32_STEP_DEG), Ok(Ba32(raw)), "{deg} steps");
    }
    for (deg, raw) in [(0.4, 0), (0.6, 1), (-0.6, -1), (2_147_483_647.4, i32::MAX)] {
        assert_eq!(Sa32::from_deg(deg * SA32_STEP_DEG), Ok(Sa32(raw)), "{deg} steps");
    }
    assert_eq!(Sa32::from_deg(-90.0), Ok(Sa32(i32::MIN)));
    assert_eq!(Sa32::from_deg(90.0), Ok(Sa32(i32::MAX)));
    assert_eq!(Sa16::from_deg(90.0), Ok(Sa16(i16::MAX)));
    assert_eq!(Ba32::from_deg(-180.0), Ok(Ba32(1 << 31)));
    assert_eq!(Ba32::from_deg(540.0), Ok(Ba32(1 << 31)));
}

#[test]
fn raw_angles_come_back_from_degrees() {
    for raw in
        [0, 1, 2, 0x7fff_ffff, 0x8000_0000, 0x8000_0001, u32::MAX - 1, u32::MAX, 2_935_780_205]
    {
        assert_eq!(Ba32::from_deg(Ba32(raw).deg()), Ok(Ba32(raw)));
        assert_eq!(Ba32::from_deg(Ba32(raw).signed_deg()), Ok(Ba32(raw)));
        let signed = Sa32(raw.cast_signed());
        assert_eq!(Sa32::from_deg(signed.deg()), Ok(signed));
    }
    for raw in 0..=u16::MAX {
        assert_eq!(Ba16::from_deg(Ba16(raw).deg()), Ok(Ba16(raw)));
        assert_eq!(Sa16::from_deg(Sa16(raw.cast_signed()).deg()), Ok(Sa16(raw.cast_signed())));
    }
}

#[test]
fn impossible_angles_are_refused() {
    let refused = |result: Result<Sa32, OutOfRange>| result.unwrap_err().field;
    assert_eq!(refused(Sa32::from_deg(90.000_001)), "SA32");
    assert_eq!(refused(Sa32::from_deg(f64::NAN)), "SA32");
    assert!(Ba32::from_deg(f64::INFINITY).is_err());
    assert!(Sa16::from_deg(-90.01).is_err());
}

#[test]
fn extents_have_a_sign_and_a_fraction() {
    same(B16(0x7fff).value(), 255.992_187_5);
    same(B16(0x8080).value(), -1.0);
    assert_eq!(B16::from_value(10.5), Ok(B16(0x540)));
    assert_eq!(B16::from_value(255.992_187_5), Ok(B16(0x7fff)));
    assert!(B16::from_value(256.0).is_err());
    assert!(B16::from_value(-0.1).is_err());
}

#[test]
fn reports_take_metres_and_seconds() {
    let sigmas =
        TargetSigmas { slant_m: 10.004, cross_m: 25.06, height_m: 4.6, radial_m_per_s: 0.505 };
    let report = TargetReport::at_deg(-45.0, 90.0).unwrap();
    let report = report.with_height(-999.6).unwrap().with_velocity(-327.68, 655.35).unwrap();
    let report = report.with_snr(-128.0).unwrap().with_sigmas(sigmas).unwrap();
    assert_eq!(report.latitude, Some(Sa32(-(1 << 30))));
    assert_eq!(report.longitude, Some(Ba32(1 << 30)));
    assert_eq!(report.height_m, Some(-1000));
    assert_eq!(report.radial_velocity_cm_per_s, Some(i16::MIN));
    assert_eq!(report.wrap_velocity_cm_per_s, Some(u16::MAX));
    assert_eq!(report.snr_db, Some(i8::MIN));
    assert_eq!((report.slant_sigma_cm, report.cross_sigma_dm), (Some(1000), Some(251)));
    assert_eq!((report.height_sigma_m, report.radial_sigma_cm_per_s), (Some(5), Some(51)));
}

#[test]
fn numbers_that_do_not_fit_name_their_field() {
    let report = TargetReport::at_deg(0.0, 0.0).unwrap();
    let field = |result: Result<TargetReport, OutOfRange>| result.unwrap_err().field;
    assert_eq!(field(report.with_height(-1001.0)), "D32.6");
    assert_eq!(field(report.with_velocity(327.68, 0.0)), "D32.7");
    assert_eq!(field(report.with_velocity(0.0, -1.0)), "D32.8");
    assert_eq!(field(report.with_snr(128.0)), "D32.9");
    let sigmas = TargetSigmas { slant_m: 1.0, cross_m: 1.0, height_m: 1.0, radial_m_per_s: 1.0 };
    assert_eq!(field(report.with_sigmas(TargetSigmas { slant_m: 656.0, ..sigmas })), "D32.12");
    assert_eq!(field(report.with_sigmas(TargetSigmas { cross_m: 6554.0, ..sigmas })), "D32.13");
    assert_eq!(field(report.with_sigmas(TargetSigmas { height_m: 256.0, ..sigmas })), "D32.14");
    let vague = TargetSigmas { radial_m_per_s: 50.01, ..sigmas };
    assert_eq!(field(report.with_sigmas(vague)), "D32.15");
    let error = report.with_velocity(400.0, 0.0).unwrap_err();
    assert_eq!(error.to_string(), "D32.7 holds -327.68 to 327.67 m/s; 400 does not fit");
    assert!(dwell().with_minimum_velocity(25.6).is_err());
}

#[test]
fn texts_are_filled_with_spaces_and_refused_by_name() {
    let text = Text::<6>::new("AB").unwrap();
    assert_eq!(text.0, *b"AB    ");
    assert_eq!(text.trimmed(), "AB");
    assert_eq!(Text(*b"\0Te\xffst\0").trimmed(), "Te\u{fffd}st");
    let wide = "ABC".to_owned();
    let long = TextError::TooLong { text: wide.clone(), length: 3, width: 2 };
    assert_eq!(Text::<2>::new(&wide), Err(long));
    let foreign = TextError::NotBasic { text: "Ä".to_owned(), found: 'Ä' };
    assert_eq!(Text::<2>::new("Ä"), Err(foreign));
}

fn mission(year: u16, month: u8, day: u8) -> Mission {
    Mission { year, month, day, ..Mission::default() }
}

/// Days since 1970 counted one by one.
#[test]
fn dates_are_those_of_the_calendar() {
    let mut days = 0;
    for year in 1970..=2110_u16 {
        let leap = (year % 4 == 0 && year % 100 != 0) || year % 400 == 0;
        let lengths = [31, if leap { 29 } else { 28 }, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
        for (month, length) in (1..).zip(lengths) {
            for day in 1..=length {
                let found = mission(year, month, day).midnight_unix_ms();
                assert_eq!(found, Ok(days * 86_400_000), "{year}-{month}-{day}");
                days += 1;
            }
            let (month_end, day) = (month, length + 1);
            let refused = NoSuchDate { year, month: month_end, day };
            assert_eq!(mission(year, month, day).midnight_unix_ms(), Err(refused));
        }
    }
    assert!(mission(2024, 0, 1).midnight_unix_ms().is_err());
    assert!(mission(2024, 13, 1).midnight_unix_ms().is_err());
    assert!(mission(2024, 1, 0).midnight_unix_ms().is_err());
}

#[test]
fn times_go_on_over_midnight() {
    let day_ms = 86_400_000_u32;
    let mut clock = MissionClock::default();
    assert_eq!(clock.unix_ms(5), None);
    clock.set(&mission(1970, 1, 2)).unwrap();
    let start = i64::from(day_ms);
    // One sender counts on.
    assert_eq!(clock.unix_ms(day_ms - 1), Some(start + 86_399_999));
    assert_eq!(clock.unix_ms(day_ms + 1), Some(start + 86_400_001));
    assert_eq!(clock.time_ms(start + 86_400_001), Some(day_ms + 1));
    assert_eq!(clock.time_ms(start - 1), None);
    // A dwell that comes 14 hours late is still on its own day.
    assert_eq!(clock.unix_ms(day_ms + 50_400_001), Some(2 * start + 50_400_001));
    assert_eq!(clock.unix_ms(day_ms + 1), Some(2 * start + 1));
    // Another begins again at zero, repeats its date, and sends one dwell late.
    clock = MissionClock::default();
    clock.set(&mission(1970, 1, 2)).unwrap();
    let late = [(day_ms - 5, -5), (3, 3), (day_ms - 2, -2), (4, 4), (1_000_000, 1_000_000)];
    for (time_ms, after_midnight_ms) in late {
        clock.set(&mission(1970, 1, 2)).unwrap();
        assert_eq!(clock.unix_ms(time_ms), Some(2 * start + after_midnight_ms));
    }
    // A new date begins anew; an impossible one changes nothing.
    clock.set(&mission(1970, 1, 4)).unwrap();
    assert!(clock.set(&mission(1970, 2, 30)).is_err());
    assert_eq!(clock.unix_ms(7), Some(3 * start + 7));
    assert!((clock.unix_s(7).unwrap() - 259_200.007).abs() < 1e-9);
}
