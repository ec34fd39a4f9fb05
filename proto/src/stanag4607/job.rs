//! The job definition segment: what the radar was asked to do and how well it can.

use super::error::ReadError;
use super::number::{Ba16, Ba32, Sa32, Text};
use super::table::{Cursor, Field, Fixed, fixed_table};
use super::units::{CM_PER_M, DM_PER_M};

fixed_table! {
    /// The job definition segment (type 5).
    ///
    /// All sensor errors are nominal standard deviations; the largest number of a field, or its
    /// upper half in J22, means that the sender makes no statement, which the methods give as
    /// `None`.
    pub struct JobDefinition {
        /// J1: the job, not 0.
        job_id: u32 = "J1",
        /// J2: the type of the sensor, of the standard's list.
        sensor_type: u8 = "J2",
        /// J3: its model.
        sensor_model: Text<6> = "J3",
        /// J4: filters applied: bit 0 area, bit 1 vicinity of roads, bit 2 confirmed tracks.
        target_filtering: u8 = "J4",
        /// J5: 1 the highest to 99 the lowest; 255 ends the job.
        priority: u8 = "J5",
        /// J6: latitude of the first corner of the area, clockwise.
        a_latitude: Sa32 = "J6",
        /// J7: longitude of the first corner.
        a_longitude: Ba32 = "J7",
        /// J8: latitude of the second corner.
        b_latitude: Sa32 = "J8",
        /// J9: longitude of the second corner.
        b_longitude: Ba32 = "J9",
        /// J10: latitude of the third corner.
        c_latitude: Sa32 = "J10",
        /// J11: longitude of the third corner.
        c_longitude: Ba32 = "J11",
        /// J12: latitude of the fourth corner.
        d_latitude: Sa32 = "J12",
        /// J13: longitude of the fourth corner.
        d_longitude: Ba32 = "J13",
        /// J14: the mode of the radar, of the standard's list.
        radar_mode: u8 = "J14",
        /// J15: time between two looks at a place, tenths of a second; 0 where not known.
        revisit_ds: u16 = "J15",
        /// J16: error of the sensor's position along its track, decimetres.
        along_sigma_dm: u16 = "J16",
        /// J17: error of the sensor's position across its track, decimetres.
        across_sigma_dm: u16 = "J17",
        /// J18: error of the sensor's altitude, decimetres.
        altitude_sigma_dm: u16 = "J18",
        /// J19: error of the sensor's direction of motion, degrees.
        track_sigma_deg: u8 = "J19",
        /// J20: error of the sensor's speed, millimetres per second.
        speed_sigma_mm_per_s: u16 = "J20",
        /// J21: error of a slant range, centimetres.
        slant_sigma_cm: u16 = "J21",
        /// J22: error of the angle across the line of sight.
        cross_sigma: Ba16 = "J22",
        /// J23: error of a radial velocity, centimetres per second.
        radial_sigma_cm_per_s: u16 = "J23",
        /// J24: slowest radial velocity that is detected, decimetres per second.
        minimum_velocity_dm_per_s: u8 = "J24",
        /// J25: probability of detection, percent.
        detection_percent: u8 = "J25",
        /// J26: density of false alarms, decibels below one per square metre.
        false_alarm_minus_db: u8 = "J26",
        /// J27: the terrain model that heights came from, of the standard's list.
        terrain_model: u8 = "J27",
        /// J28: the geoid model, of the standard's list.
        geoid_model: u8 = "J28",
    }
}

impl JobDefinition {
    /// Corners of the area, (latitude, longitude), clockwise.
    #[must_use]
    pub fn corners(&self) -> [(Sa32, Ba32); 4] {
        [
            (self.a_latitude, self.a_longitude),
            (self.b_latitude, self.b_longitude),
            (self.c_latitude, self.c_longitude),
            (self.d_latitude, self.d_longitude),
        ]
    }

    /// J15: time between two looks at a place, seconds.
    #[must_use]
    pub fn revisit_s(&self) -> Option<f64> {
        (self.revisit_ds != 0).then(|| f64::from(self.revisit_ds) / 10.0)
    }

    /// J21: standard deviation of a slant range, metres.
    #[must_use]
    pub fn slant_sigma_m(&self) -> Option<f64> {
        stated(self.slant_sigma_cm).map(|cm| cm / CM_PER_M)
    }

    /// J22: standard deviation of the angle across the line of sight, radians.
    #[must_use]
    pub fn cross_sigma_rad(&self) -> Option<f64> {
        (self.cross_sigma.0 < 0x8000).then(|| self.cross_sigma.rad())
    }

    /// J23: standard deviation of a radial velocity, metres per second.
    #[must_use]
    pub fn radial_sigma_m_per_s(&self) -> Option<f64> {
        stated(self.radial_sigma_cm_per_s).map(|cm_per_s| cm_per_s / CM_PER_M)
    }

    /// J24: slowest radial velocity that is detected, metres per second.
    #[must_use]
    pub fn minimum_velocity_m_per_s(&self) -> Option<f64> {
        stated_byte(self.minimum_velocity_dm_per_s).map(|dm_per_s| dm_per_s / DM_PER_M)
    }

    /// J25: probability that a target is detected, 0 to 1.
    #[must_use]
    pub fn detection_probability(&self) -> Option<f64> {
        stated_byte(self.detection_percent).map(|percent| percent / 100.0)
    }

    /// J26: false alarms per square metre, `10^(−J26/10)`.
    #[must_use]
    pub fn false_alarms_per_m2(&self) -> Option<f64> {
        stated_byte(self.false_alarm_minus_db).map(|db| 10_f64.powf(-db / 10.0))
    }
}

fn stated(raw: u16) -> Option<f64> {
    (raw != u16::MAX).then(|| f64::from(raw))
}

fn stated_byte(raw: u8) -> Option<f64> {
    (raw != u8::MAX).then(|| f64::from(raw))
}
