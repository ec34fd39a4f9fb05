//! What came of an input as a whole: a row for each track, purity where the truth is known.

use std::collections::BTreeMap;

use anyhow::bail;
use proto::plots::Scan;
use proto::wire::MapStatus;

use super::step::Step;

/// Counts of one run, and a line for each track.
#[derive(Default)]
pub(super) struct Summary {
    pub(super) dwell_count: u64,
    plot_count: usize,
    tracks: BTreeMap<u64, TrackLine>,
    /// Height of each track's newest plot, metres.
    pub(super) heights_m: BTreeMap<u64, f64>,
    damages: BTreeMap<&'static str, (u64, String)>,
}

struct TrackLine {
    from: String,
    to: String,
    step_count: usize,
    plot_count: usize,
    status: MapStatus,
    was_confirmed: bool,
    place: String,
    speed_m_per_s: f64,
    /// How many of its plots are of each target; of clutter under `None`.
    targets: BTreeMap<Option<u32>, usize>,
}

impl Summary {
    pub(super) fn count(&mut self, scan: &Scan) {
        self.dwell_count += 1;
        self.plot_count += scan.plot_count();
    }

    pub(super) fn damaged(&mut self, label: &'static str, reason: &str) {
        let (count, _) = self.damages.entry(label).or_insert_with(|| (0, reason.to_owned()));
        *count += 1;
    }

    /// How much could not be used; a missing date costs nothing.
    pub(super) fn damage_count(&self) -> u64 {
        let lost = self.damages.iter().filter(|(label, _)| **label != "undated");
        lost.map(|(_, (count, _))| count).sum()
    }

    pub(super) fn take(&mut self, step: &Step) {
        let (time, place, speed_m_per_s) = step.shown();
        let line = self.tracks.entry(step.id()).or_insert_with(|| TrackLine {
            from: time.clone(),
            to: String::new(),
            step_count: 0,
            plot_count: 0,
            status: step.status(),
            was_confirmed: false,
            place: String::new(),
            speed_m_per_s: 0.0,
            targets: BTreeMap::new(),
        });
        line.step_count += 1;
        line.status = step.status();
        line.was_confirmed |= !step.is_tentative();
        (line.to, line.place, line.speed_m_per_s) = (time, place, speed_m_per_s);
        if let Some(truth) = step.truth() {
            line.plot_count += 1;
            *line.targets.entry(truth).or_default() += 1;
        }
    }

    /// The tracks that were confirmed at some time.
    fn confirmed(&self) -> impl Iterator<Item = (&u64, &TrackLine)> {
        self.tracks.iter().filter(|(_, line)| line.was_confirmed)
    }

    /// Share of the plots of confirmed tracks that are of the target that their track has most of;
    /// `None` where no plot says its target.
    pub(super) fn purity(&self) -> Option<f64> {
        let is_known = |line: &TrackLine| line.targets.keys().any(Option::is_some);
        if !self.confirmed().any(|(_, line)| is_known(line)) {
            return None;
        }
        let pure: usize = self.confirmed().map(|(_, line)| line.most()).sum();
        let all: usize = self.confirmed().map(|(_, line)| line.plot_count).sum();
        Some(pure as f64 / (all as f64).max(1.0))
    }

    pub(super) fn table(&self) -> String {
        let mut table = comfy_table::Table::new();
        table.load_style(comfy_table::presets::UTF8_HORIZONTAL_ONLY);
        table.set_header(["track", "status", "from", "to", "looks", "plots", "last at", "m/s"]);
        for (id, line) in self.confirmed() {
            table.add_row([
                id.to_string(),
                line.status.name().to_owned(),
                line.from.clone(),
                line.to.clone(),
                line.step_count.to_string(),
                line.plot_count.to_string(),
                line.place.clone(),
                format!("{:.1}", line.speed_m_per_s),
            ]);
        }
        let count = self.confirmed().count();
        let tentative = match self.tracks.len() - count {
            0 => String::new(),
            more => format!("({more} more were never confirmed) "),
        };
        let Self { dwell_count, plot_count, .. } = self;
        let purity = self.purity().map_or_else(String::new, |p| format!("; purity {p:.3}"));
        let damaged = match self.damage_count() {
            0 => String::new(),
            lost => format!("; {} of the input left out", counted(lost, "part")),
        };
        format!(
            "{table}\n{} {tentative}of {} with {}{purity}{damaged}\n",
            counted(count as u64, "track"),
            counted(*dwell_count, "dwell"),
            counted(*plot_count as u64, "plot")
        )
    }

    /// Fails if anything had to be left out.
    pub(super) fn verdict(&self, name: &str) -> anyhow::Result<()> {
        let lost = self.damages.iter().filter(|(label, _)| **label != "undated");
        let Some((_, (_, first))) = lost.max_by_key(|(_, (count, _))| *count) else {
            return Ok(());
        };
        bail!(
            "{name}: {} could not be used; one of them: {first}",
            counted(self.damage_count(), "part")
        )
    }
}

/// So many of a thing.
fn counted(count: u64, thing: &str) -> String {
    if count == 1 { format!("1 {thing}") } else { format!("{count} {thing}s") }
}

impl TrackLine {
    /// Plots of the target that the track has most of.
    fn most(&self) -> usize {
        let known = self.targets.iter().filter(|(target, _)| target.is_some());
        known.map(|(_, count)| *count).max().unwrap_or(0)
    }
}
