//! STANAG 4607 packets to dwells.

use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;

use super::{Damage, Scan};
use crate::geodesy::{EnuFrame, GeoPosition};
use crate::ids::NodeId;
use crate::stanag4607::{
    Dwell as Segmented, Geodetic, JobDefinition, MissionClock, Packet, SIMULATED, Segment,
    TargetReport,
};
use crate::wire::{Dwell, DwellArea, DwellReport, FlightRecord, GeoRecord, Message};

/// Platforms and jobs that are remembered; those beyond push the first out.
const MAX_REMEMBERED_COUNT: usize = 256;
/// The same of exercises (P7).
const SIMULATED_EXERCISE: u8 = 129;

/// Whose the dwells are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Naming {
    /// All of one node, whatever the input says: an agent speaks for itself only.
    Fixed(NodeId),
    /// As the input names its platforms and sensors; of this node where it does not.
    Own(NodeId),
}

impl Naming {
    /// The node that what does not name itself is of.
    #[must_use]
    pub fn fallback(&self) -> &NodeId {
        let (Self::Fixed(node) | Self::Own(node)) = self;
        node
    }

    /// The node of something called `name`: lower case, other characters as `-`.
    #[must_use]
    pub fn node(&self, name: &str) -> NodeId {
        let Self::Own(fallback) = self else { return self.fallback().clone() };
        let plain = |letter: char| match letter.to_ascii_lowercase() {
            lower @ ('a'..='z' | '0'..='9') => lower,
            _ => '-',
        };
        let text: String = name.trim().chars().map(plain).collect();
        text.trim_matches('-').parse().unwrap_or_else(|_| fallback.clone())
    }
}

/// Makes dwells of packets, with what earlier packets said of mission and job.
#[derive(Clone, Debug)]
pub struct PacketScans {
    naming: Naming,
    clocks: BTreeMap<String, MissionClock>,
    jobs: BTreeMap<(String, u32), JobDefinition>,
    /// Of the newest report that states one: areas have none.
    height_m: f64,
}

/// What a dwell segment stands in.
struct Context<'a> {
    platform: &'a str,
    job: Option<&'a JobDefinition>,
    is_simulated: bool,
}

impl PacketScans {
    /// Knows no mission yet.
    #[must_use]
    pub fn new(naming: Naming) -> Self {
        Self { naming, clocks: BTreeMap::new(), jobs: BTreeMap::new(), height_m: 0.0 }
    }

    /// The dwells of a packet, in its order. A report without a place, or one that makes no sense,
    /// costs that report only.
    pub fn take(&mut self, packet: &Packet, into: &mut Vec<Result<Scan, Damage>>) {
        let origin = &packet.header.origin;
        let platform = origin.platform_id.trimmed();
        let is_simulated = [SIMULATED, SIMULATED_EXERCISE].contains(&origin.exercise);
        for segment in &packet.segments {
            match segment {
                Segment::Mission(mission) => {
                    let clock = self.clock(&platform).set(mission);
                    let damage = |fault| Damage::Mission { platform: platform.clone(), fault };
                    into.extend(clock.err().map(|fault| Err(damage(fault))));
                }
                Segment::JobDefinition(job) => {
                    let key = (platform.clone(), job.job_id);
                    forget_first(&mut self.jobs, &key);
                    self.jobs.insert(key, **job);
                }
                Segment::Dwell(dwell) => {
                    let key = (platform.clone(), origin.job_id);
                    let job = self.jobs.get(&key).copied();
                    let context = Context { platform: &platform, job: job.as_ref(), is_simulated };
                    self.take_dwell(dwell, &context, into);
                }
                _ => {}
            }
        }
    }

    fn clock(&mut self, platform: &str) -> &mut MissionClock {
        forget_first(&mut self.clocks, &platform.to_owned());
        self.clocks.entry(platform.to_owned()).or_default()
    }

    fn take_dwell(
        &mut self,
        dwell: &Segmented,
        context: &Context<'_>,
        into: &mut Vec<Result<Scan, Damage>>,
    ) {
        let Some(time_unix_s) = self.time_unix_s(dwell, context.platform, into) else { return };
        let node = self.naming.node(context.platform);
        let stated = dwell.reports.iter().find_map(|report| report.height_m);
        self.height_m = stated.map_or(self.height_m, f64::from);
        let mut empty = head(dwell, context, node, time_unix_s);
        empty.area.center.height_m = self.height_m;
        if let Err(fault) = empty.check() {
            return into.push(Err(damaged(dwell, None, fault)));
        }
        let mut reports = Vec::with_capacity(dwell.reports.len());
        for (index, report) in dwell.reports.iter().enumerate() {
            let index = u32::try_from(index).unwrap_or(u32::MAX);
            match report_of(dwell, report, index, context.job) {
                Some(found) => match found.check() {
                    Ok(()) => reports.push(found),
                    Err(fault) => into.push(Err(damaged(dwell, Some(index), fault))),
                },
                None => into.push(Err(Damage::Placeless {
                    revisit_index: dwell.revisit_index,
                    dwell_index: dwell.dwell_index,
                    report_index: index,
                })),
            }
        }
        if reports.is_empty() {
            return into.push(Ok(Scan::Geographic(Box::new(empty))));
        }
        // Without padding: a message holds fewer reports than a segment may.
        for part in reports.chunks(Dwell::MAX_REPORT_COUNT) {
            let whole = Dwell { reports: part.to_vec(), ..empty.clone() };
            into.push(Ok(Scan::Geographic(Box::new(whole))));
        }
    }

    /// When; where no mission has said the date, on the first day of 1970.
    fn time_unix_s(
        &mut self,
        dwell: &Segmented,
        platform: &str,
        into: &mut Vec<Result<Scan, Damage>>,
    ) -> Option<f64> {
        let is_new = !self.clocks.contains_key(platform);
        let dated = self.clock(platform).unix_s(dwell.time_ms);
        if dated.is_none() && is_new {
            into.push(Err(Damage::Undated { platform: platform.to_owned() }));
        }
        dated.or(Some(f64::from(dwell.time_ms) / 1000.0))
    }
}

/// Makes room for `key`.
fn forget_first<K: Ord + Clone, V>(map: &mut BTreeMap<K, V>, key: &K) {
    if MAX_REMEMBERED_COUNT <= map.len() && !map.contains_key(key) {
        map.pop_first();
    }
}

fn damaged(dwell: &Segmented, report_index: Option<u32>, fault: crate::wire::Invalid) -> Damage {
    let Segmented { revisit_index, dwell_index, .. } = *dwell;
    Damage::Senseless { revisit_index, dwell_index, report_index, fault }
}

/// The dwell without its reports.
fn head(dwell: &Segmented, context: &Context<'_>, node: NodeId, time_unix_s: f64) -> Dwell {
    let Geodetic { lat_deg, lon_deg, height_m } = dwell.sensor();
    let area = dwell.area();
    let flight = dwell.motion().map(|motion| FlightRecord {
        course_deg: motion.track_rad.to_degrees(),
        speed_m_per_s: motion.speed_m_per_s,
        climb_m_per_s: motion.climb_m_per_s,
    });
    let of_job = context.job.and_then(JobDefinition::minimum_velocity_m_per_s);
    let probability = context.job.and_then(JobDefinition::detection_probability);
    Dwell {
        node,
        time_unix_s,
        revisit_index: u32::from(dwell.revisit_index),
        dwell_index: u32::from(dwell.dwell_index),
        is_last_of_revisit: dwell.ends_revisit(),
        sensor: GeoRecord { lat_deg, lon_deg, height_m },
        flight,
        area: DwellArea {
            center: GeoRecord { lat_deg: area.lat_deg, lon_deg: area.lon_deg, height_m: 0.0 },
            range_half_extent_m: area.half_range_m,
            angle_half_extent_deg: area.half_angle_rad.to_degrees(),
        },
        minimum_detectable_m_per_s: dwell.minimum_velocity_m_per_s().or(of_job),
        // A radar that never detects anything has not said how often it does.
        detection_probability: probability.filter(|share| 0.0 < *share && *share <= 1.0),
        is_simulated: context.is_simulated,
        reports: Vec::new(),
    }
}

/// A report with the job's errors where it states none; `None` if it has no place.
fn report_of(
    dwell: &Segmented,
    report: &TargetReport,
    index: u32,
    job: Option<&JobDefinition>,
) -> Option<DwellReport> {
    let (lat_deg, lon_deg) = dwell.location_deg(report)?;
    let height_m = report.height_m.map_or(0.0, f64::from);
    let place = GeoRecord { lat_deg, lon_deg, height_m };
    // A standard deviation of zero is one that the sender did not know.
    let stated = |sigma: Option<f64>| sigma.filter(|sigma| 0.0 < *sigma);
    let cross = || {
        let angle_rad = job?.cross_sigma_rad().filter(|angle_rad| *angle_rad < FRAC_PI_2)?;
        Some(angle_rad * distance_m(dwell, &place)?)
    };
    let slant = || job?.slant_sigma_m();
    let radial = || job?.radial_sigma_m_per_s();
    Some(DwellReport {
        index: report.index.map_or(index, u32::from),
        place,
        slant_sigma_m: stated(report.slant_sigma_m()).or_else(|| stated(slant())),
        cross_sigma_m: stated(report.cross_sigma_m()).or_else(|| stated(cross())),
        radial_m_per_s: report.radial_velocity_m_per_s(),
        radial_sigma_m_per_s: stated(report.radial_sigma_m_per_s()).or_else(|| stated(radial())),
        wrap_m_per_s: stated(report.wrap_velocity_m_per_s()),
        snr_db: report.snr_db.map(f64::from),
        truth: report.truth().map(|tag| tag.entity),
    })
}

/// From the sensor to a place.
fn distance_m(dwell: &Segmented, place: &GeoRecord) -> Option<f64> {
    let Geodetic { lat_deg, lon_deg, height_m } = dwell.sensor();
    let sensor = EnuFrame::new(GeoPosition::new(lat_deg, lon_deg, height_m).ok()?);
    let at = GeoPosition::new(place.lat_deg, place.lon_deg, place.height_m).ok()?;
    Some(sensor.look_at(&at).slant_range_m)
}
