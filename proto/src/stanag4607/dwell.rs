//! The dwell segment: one look of the radar at an area, with what it saw there.

use super::error::{Fault, ReadError};
use super::number::{B16, Ba16, Ba32, Sa16, Sa32};
use super::table::{Cursor, Field, Masked, Slot, masked_table};

masked_table! {
    /// The dwell segment (type 2), field by field as it travels.
    ///
    /// [`Dwell::sealed`] makes D1 and D5 agree with the rest. The 16 spare bits of D1 and, where
    /// there are no reports, the bits of D32 are kept as they were read.
    pub struct Dwell {
        /// D2: counts the visits of the job's area.
        revisit_index: u16 = "D2" @ 63,
        /// D3: counts the dwells of a visit, from 0.
        dwell_index: u16 = "D3" @ 62,
        /// D4: 1 if no more dwells of this visit follow.
        last_dwell: u8 = "D4" @ 61,
        /// D5: how many target reports follow.
        report_count: u16 = "D5" @ 60,
        /// D6: milliseconds since 00:00 UTC of the mission's reference date, at the dwell's middle.
        time_ms: u32 = "D6" @ 59,
        /// D7: latitude of the sensor, WGS 84.
        sensor_latitude: Sa32 = "D7" @ 58,
        /// D8: longitude of the sensor, east.
        sensor_longitude: Ba32 = "D8" @ 57,
        /// D9: height of the sensor above the ellipsoid, centimetres.
        sensor_altitude_cm: i32 = "D9" @ 56,
        /// D10: latitude of one step of D32.4.
        latitude_scale: Option<Sa32> = "D10" @ 55,
        /// D11: longitude of one step of D32.5.
        longitude_scale: Option<Ba32> = "D11" @ 54,
        /// D12: error of the sensor's position along its track, centimetres.
        along_sigma_cm: Option<u32> = "D12" @ 53,
        /// D13: error of the sensor's position across its track, centimetres.
        across_sigma_cm: Option<u32> = "D13" @ 52,
        /// D14: error of the sensor's altitude, centimetres.
        altitude_sigma_cm: Option<u16> = "D14" @ 51,
        /// D15: direction of the sensor's motion, clockwise from true north.
        track: Option<Ba16> = "D15" @ 50,
        /// D16: speed of the sensor over ground, millimetres per second.
        speed_mm_per_s: Option<u32> = "D16" @ 49,
        /// D17: climb of the sensor, decimetres per second, positive up.
        climb_dm_per_s: Option<i8> = "D17" @ 48,
        /// D18: error of D15, degrees.
        track_sigma_deg: Option<u8> = "D18" @ 47,
        /// D19: error of D16, millimetres per second.
        speed_sigma_mm_per_s: Option<u16> = "D19" @ 46,
        /// D20: error of D17, centimetres per second.
        climb_sigma_cm_per_s: Option<u16> = "D20" @ 45,
        /// D21: heading of the platform, clockwise from true north.
        platform_heading: Option<Ba16> = "D21" @ 44,
        /// D22: pitch of the platform, positive nose up.
        platform_pitch: Option<Sa16> = "D22" @ 43,
        /// D23: roll of the platform, positive left wing up.
        platform_roll: Option<Sa16> = "D23" @ 42,
        /// D24: latitude of the centre of the area looked at.
        area_latitude: Sa32 = "D24" @ 41,
        /// D25: longitude of the centre of the area looked at.
        area_longitude: Ba32 = "D25" @ 40,
        /// D26: half the extent of the area in range, kilometres.
        area_half_range: B16 = "D26" @ 39,
        /// D27: half the extent of the area in angle, seen from the sensor.
        area_half_angle: Ba16 = "D27" @ 38,
        /// D28: heading of the sensor relative to the platform.
        sensor_heading: Option<Ba16> = "D28" @ 37,
        /// D29: pitch of the sensor relative to the platform.
        sensor_pitch: Option<Sa16> = "D29" @ 36,
        /// D30: roll of the sensor relative to the platform.
        sensor_roll: Option<Sa16> = "D30" @ 35,
        /// D31: slowest radial velocity that this dwell detects, decimetres per second.
        minimum_velocity_dm_per_s: Option<u8> = "D31" @ 34,
    }
    also {
        /// D1: which fields there are, bit 63 for D2 to bit 16 for D32.18.
        mask: u64,
        /// D32, in order.
        reports: Vec<TargetReport>,
    }
}

masked_table! {
    /// One target report (D32), field by field as it travels.
    ///
    /// All reports of a dwell have the same fields.
    #[derive(Copy)]
    pub struct TargetReport {
        /// D32.1: number of the report in its dwell; needed where HRR refers to it.
        index: Option<u16> = "D32.1" @ 33,
        /// D32.2: latitude.
        latitude: Option<Sa32> = "D32.2" @ 32,
        /// D32.3: longitude, east.
        longitude: Option<Ba32> = "D32.3" @ 31,
        /// D32.4: latitude from the area's centre, in steps of D10.
        delta_latitude: Option<i16> = "D32.4" @ 30,
        /// D32.5: longitude from the area's centre, in steps of D11.
        delta_longitude: Option<i16> = "D32.5" @ 29,
        /// D32.6: height above the ellipsoid, metres.
        height_m: Option<i16> = "D32.6" @ 28,
        /// D32.7: radial velocity, centimetres per second, positive away from the sensor.
        radial_velocity_cm_per_s: Option<i16> = "D32.7" @ 27,
        /// D32.8: the radial velocity is known up to multiples of this, centimetres per second.
        wrap_velocity_cm_per_s: Option<u16> = "D32.8" @ 26,
        /// D32.9: signal to noise ratio, decibels.
        snr_db: Option<i8> = "D32.9" @ 25,
        /// D32.10: class of the target, of the standard's list; from 128 on of a simulated one.
        classification: Option<u8> = "D32.10" @ 24,
        /// D32.11: probability that the class is right, percent.
        class_percent: Option<u8> = "D32.11" @ 23,
        /// D32.12: error of the slant range, centimetres.
        slant_sigma_cm: Option<u16> = "D32.12" @ 22,
        /// D32.13: error across the line of sight, decimetres.
        cross_sigma_dm: Option<u16> = "D32.13" @ 21,
        /// D32.14: error of the height, metres.
        height_sigma_m: Option<u8> = "D32.14" @ 20,
        /// D32.15: error of the radial velocity, centimetres per second.
        radial_sigma_cm_per_s: Option<u16> = "D32.15" @ 19,
        /// D32.16: the simulation that the truth tag is of.
        truth_application: Option<u8> = "D32.16" @ 18,
        /// D32.17: the simulated target itself.
        truth_entity: Option<u32> = "D32.17" @ 17,
        /// D32.18: radar cross section, half decibels.
        cross_section_half_db: Option<i8> = "D32.18" @ 16,
    }
}

/// The 16 lowest bits of D1, which no field uses.
pub(super) const SPARE_BITS: u64 = 0xffff;

impl Dwell {
    /// The dwell with D1 and D5 as its fields and reports have them.
    ///
    /// D1 takes the bits of D32 from the first report; a dwell whose reports have different
    /// fields, or more than 65,535 of them, is refused when it is written.
    #[must_use]
    pub fn sealed(self) -> Self {
        let reports = self.reports.first().map_or(0, TargetReport::present_bits);
        let report_count = u16::try_from(self.reports.len()).unwrap_or(u16::MAX);
        Self { mask: self.present_bits() | reports, report_count, ..self }
    }

    /// What D1 should be, apart from its spare bits and, without reports, the bits of D32.
    pub(super) fn fields(&self) -> u64 {
        let reports = match self.reports.first() {
            Some(report) => report.present_bits(),
            None => self.mask & TargetReport::BITS,
        };
        self.present_bits() | reports | self.mask & SPARE_BITS
    }

    pub(super) fn read(cursor: &mut Cursor<'_>) -> Result<Self, ReadError> {
        let start = cursor.clone();
        let mask: u64 = Field::read(cursor, "D1")?;
        if let Some(field) = Self::absent(mask) {
            return Err(start.fault(field, Fault::MandatoryAbsent { mask }));
        }
        let dwell = Self::read_table(cursor, mask)?;
        let reports = read_reports(cursor, mask, dwell.report_count)?;
        Ok(Self { mask, reports, ..dwell })
    }

    pub(super) fn write(&self, out: &mut Vec<u8>) {
        Field::write(&self.mask, out);
        self.write_table(out);
        for report in &self.reports {
            report.write_table(out);
        }
    }
}

/// D32: nothing follows where D5 is 0, whatever the mask says.
fn read_reports(
    cursor: &mut Cursor<'_>,
    mask: u64,
    count: u16,
) -> Result<Vec<TargetReport>, ReadError> {
    if count == 0 {
        return Ok(Vec::new());
    }
    let (width, available) = (TargetReport::width(mask), cursor.left());
    if width == 0 {
        return Err(cursor.fault("D32", Fault::ReportsWithoutFields { count }));
    }
    // Nothing is allocated before the bytes are known to be there.
    if available < usize::from(count) * width {
        return Err(cursor.fault("D32", Fault::CountOverruns { count, width, available }));
    }
    (0..count).map(|_| TargetReport::read_table(cursor, mask)).collect()
}
