//! The segments of a packet: which there are, and how each is read and written.

use std::fmt;

use super::dwell::Dwell;
use super::error::{Fault, ReadError};
use super::header::SEGMENT_HEADER_BYTES;
use super::job::JobDefinition;
use super::number::{Ba16, Ba32, Sa32, Text};
use super::table::{Cursor, Field, Fixed, fixed_table};

/// What a segment is, by its type byte S1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct SegmentKind(pub u8);

impl SegmentKind {
    /// Mission: plan and reference date.
    pub const MISSION: Self = Self(1);
    /// Dwell: one look of the radar with its target reports.
    pub const DWELL: Self = Self(2);
    /// High range resolution profile.
    pub const HRR: Self = Self(3);
    /// Job definition: what the radar was asked to do and how well it can.
    pub const JOB_DEFINITION: Self = Self(5);
    /// Free text.
    pub const FREE_TEXT: Self = Self(6);
    /// Test and status.
    pub const TEST_AND_STATUS: Self = Self(10);
    /// Processing history.
    pub const PROCESSING_HISTORY: Self = Self(12);
    /// Platform location.
    pub const PLATFORM_LOCATION: Self = Self(13);
}

impl fmt::Display for SegmentKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match *self {
            Self::MISSION => "mission",
            Self::DWELL => "dwell",
            Self::HRR => "high range resolution",
            Self::JOB_DEFINITION => "job definition",
            Self::FREE_TEXT => "free text",
            Self::TEST_AND_STATUS => "test and status",
            Self::PROCESSING_HISTORY => "processing history",
            Self::PLATFORM_LOCATION => "platform location",
            Self(other) => return write!(f, "type {other}"),
        };
        f.write_str(name)
    }
}

fixed_table! {
    /// The mission segment (type 1): what the platform is, and the date that times count from.
    pub struct Mission {
        /// M1: the mission's plan.
        plan: Text<12> = "M1",
        /// M2: the flight's plan.
        flight_plan: Text<12> = "M2",
        /// M3: the type of the platform, of the standard's list; 0 unidentified, 255 other.
        platform_type: u8 = "M3",
        /// M4: variant of the platform.
        platform_configuration: Text<10> = "M4",
        /// M5: year of the reference date, UTC.
        year: u16 = "M5",
        /// M6: month of the reference date, 1 to 12.
        month: u8 = "M6",
        /// M7: day of the reference date, 1 to 31.
        day: u8 = "M7",
    }
}

fixed_table! {
    /// The test and status segment (type 10): the health of the radar at a dwell.
    pub struct TestAndStatus {
        /// T1: the job.
        job_id: u32 = "T1",
        /// T2: index of the revisit.
        revisit_index: u16 = "T2",
        /// T3: index of the dwell in its revisit.
        dwell_index: u16 = "T3",
        /// T4: milliseconds since 00:00 UTC of the mission's reference date.
        time_ms: u32 = "T4",
        /// T5: failures; from the highest bit: antenna, RF electronics, processor, data link,
        /// calibration.
        hardware: u8 = "T5",
        /// T6: limits exceeded; from the highest bit: range, azimuth, elevation, temperature.
        mode: u8 = "T6",
    }
}

fixed_table! {
    /// The platform location segment (type 13): where the platform is between dwells.
    pub struct PlatformLocation {
        /// L1: milliseconds since 00:00 UTC of the mission's reference date.
        time_ms: u32 = "L1",
        /// L2: latitude, WGS 84.
        latitude: Sa32 = "L2",
        /// L3: longitude, WGS 84, east.
        longitude: Ba32 = "L3",
        /// L4: height above the ellipsoid, centimetres.
        altitude_cm: i32 = "L4",
        /// L5: direction of motion, clockwise from true north.
        track: Ba16 = "L5",
        /// L6: speed over ground, millimetres per second.
        speed_mm_per_s: u32 = "L6",
        /// L7: climb, decimetres per second, positive up.
        climb_dm_per_s: i8 = "L7",
    }
}

/// The free text segment (type 6).
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct FreeText {
    /// F1: who wrote it.
    pub originator: Text<10>,
    /// F2: for whom it is.
    pub recipient: Text<10>,
    /// F3: the text, byte by byte.
    pub text: Vec<u8>,
}

fixed_table! {
    /// C2 to C5: the data that a processing history began with.
    pub struct HistoryBase {
        /// C2: country code.
        nationality: Text<2> = "C2",
        /// C3: the platform.
        platform_id: Text<10> = "C3",
        /// C4: its mission.
        mission_id: u32 = "C4",
        /// C5: its job.
        job_id: u32 = "C5",
    }
}

fixed_table! {
    /// C6: one step of a processing history.
    pub struct HistoryStep {
        /// C6.1: number of the step, from 1.
        sequence: u8 = "C6.1",
        /// C6.2: country code of the system that modified the data.
        nationality: Text<2> = "C6.2",
        /// C6.3: that system.
        platform_id: Text<10> = "C6.3",
        /// C6.4: its mission.
        mission_id: u32 = "C6.4",
        /// C6.5: its job.
        job_id: u32 = "C6.5",
        /// C6.6: what was done, one bit each.
        processing: u16 = "C6.6",
    }
}

/// The processing history segment (type 12): who changed the data since the radar sent it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ProcessingHistory {
    /// C2 to C5.
    pub base: HistoryBase,
    /// C6, in order; C1 counts them.
    pub steps: Vec<HistoryStep>,
}

/// A segment of a packet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Segment {
    /// Type 1.
    Mission(Mission),
    /// Type 2.
    Dwell(Box<Dwell>),
    /// Type 5.
    JobDefinition(Box<JobDefinition>),
    /// Type 6.
    FreeText(FreeText),
    /// Type 10.
    TestAndStatus(TestAndStatus),
    /// Type 12.
    ProcessingHistory(ProcessingHistory),
    /// Type 13.
    PlatformLocation(PlatformLocation),
    /// Every other type, byte by byte; among them HRR, which no tracker here reads.
    Other {
        /// S1.
        kind: SegmentKind,
        /// Everything after the segment's header.
        bytes: Vec<u8>,
    },
}

impl Segment {
    /// What it is.
    #[must_use]
    pub fn kind(&self) -> SegmentKind {
        match self {
            Self::Mission(_) => SegmentKind::MISSION,
            Self::Dwell(_) => SegmentKind::DWELL,
            Self::JobDefinition(_) => SegmentKind::JOB_DEFINITION,
            Self::FreeText(_) => SegmentKind::FREE_TEXT,
            Self::TestAndStatus(_) => SegmentKind::TEST_AND_STATUS,
            Self::ProcessingHistory(_) => SegmentKind::PROCESSING_HISTORY,
            Self::PlatformLocation(_) => SegmentKind::PLATFORM_LOCATION,
            Self::Other { kind, .. } => *kind,
        }
    }

    /// From what follows a segment's header, to the last byte.
    pub(super) fn read(kind: SegmentKind, cursor: &mut Cursor<'_>) -> Result<Self, ReadError> {
        let segment = match kind {
            SegmentKind::MISSION => Self::Mission(Mission::read(cursor)?),
            SegmentKind::DWELL => Self::Dwell(Box::new(Dwell::read(cursor)?)),
            SegmentKind::JOB_DEFINITION => {
                Self::JobDefinition(Box::new(JobDefinition::read(cursor)?))
            }
            SegmentKind::FREE_TEXT => Self::FreeText(FreeText::read(cursor)?),
            SegmentKind::TEST_AND_STATUS => Self::TestAndStatus(TestAndStatus::read(cursor)?),
            SegmentKind::PROCESSING_HISTORY => {
                Self::ProcessingHistory(ProcessingHistory::read(cursor)?)
            }
            SegmentKind::PLATFORM_LOCATION => {
                Self::PlatformLocation(PlatformLocation::read(cursor)?)
            }
            _ => Self::Other { kind, bytes: cursor.rest("bytes")?.to_vec() },
        };
        cursor.finish()?;
        Ok(segment)
    }

    /// Header and fields to the end of `out`; whether the size could be said.
    pub(super) fn write(&self, out: &mut Vec<u8>) -> Result<(), usize> {
        let start = out.len();
        out.push(self.kind().0);
        out.extend_from_slice(&[0; SEGMENT_HEADER_BYTES - 1]);
        match self {
            Self::Mission(mission) => mission.write(out),
            Self::Dwell(dwell) => dwell.write(out),
            Self::JobDefinition(job) => job.write(out),
            Self::FreeText(text) => text.write(out),
            Self::TestAndStatus(status) => status.write(out),
            Self::ProcessingHistory(history) => history.write(out),
            Self::PlatformLocation(location) => location.write(out),
            Self::Other { bytes, .. } => out.extend_from_slice(bytes),
        }
        let size = out.len() - start;
        let bytes = u32::try_from(size).ok().ok_or(size)?.to_be_bytes();
        out[start + 1..start + SEGMENT_HEADER_BYTES].copy_from_slice(&bytes);
        Ok(())
    }
}

impl FreeText {
    fn read(cursor: &mut Cursor<'_>) -> Result<Self, ReadError> {
        let originator = Field::read(cursor, "F1")?;
        let recipient = Field::read(cursor, "F2")?;
        let text = cursor.rest("F3")?.to_vec();
        Ok(Self { originator, recipient, text })
    }

    fn write(&self, out: &mut Vec<u8>) {
        Field::write(&self.originator, out);
        Field::write(&self.recipient, out);
        out.extend_from_slice(&self.text);
    }
}

impl ProcessingHistory {
    fn read(cursor: &mut Cursor<'_>) -> Result<Self, ReadError> {
        let count: u8 = Field::read(cursor, "C1")?;
        let base = HistoryBase::read(cursor)?;
        let (width, available) = (HistoryStep::WIDTH, cursor.left());
        if available < usize::from(count) * width {
            let fault = Fault::CountOverruns { count: count.into(), width, available };
            return Err(cursor.fault("C6", fault));
        }
        let steps = (0..count).map(|_| HistoryStep::read(cursor)).collect::<Result<_, _>>()?;
        Ok(Self { base, steps })
    }

    /// The count is cut to a byte; the writer has refused longer histories before.
    fn write(&self, out: &mut Vec<u8>) {
        out.push(u8::try_from(self.steps.len()).unwrap_or(u8::MAX));
        self.base.write(out);
        for step in &self.steps {
            step.write(out);
        }
    }
}
