//! What the experiments leave: a table, one JSON document, pictures.

use std::path::Path;

use comfy_table::presets::UTF8_HORIZONTAL_ONLY;
use comfy_table::{CellAlignment, Table};
use serde::Serialize;

use super::super::Results;
use super::super::sheet::{Bar, document, draw, write};
use super::picture::Page;
use super::published::{Bounds, bounds};
use super::summary::{Figure, Figures};
use super::{SceneResult, TrackerResult};
use crate::metrics::Settings;

/// The tracker that must reach the bars.
const JUDGED: &str = "default";

/// Everything the experiments have shown.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Report {
    pub(super) seed: u64,
    pub(super) trial_count: usize,
    /// What counts as found, and how far GOSPA and OSPA look.
    pub(super) settings: Settings,
    /// Signal-to-noise ratio of people in the image, decibels.
    pub(super) snr_db: f64,
    pub(super) experiments: Vec<SceneResult>,
    /// How long all of it took, seconds. Differs from run to run.
    pub(super) elapsed_s: f64,
}

impl Results for Report {
    fn table(&self) -> String {
        let mut table = Table::new();
        table.load_style(UTF8_HORIZONTAL_ONLY).set_header([
            "experiment",
            "tracker",
            "RMSE m (95 %)",
            "near side m",
            "smoothed m",
            "missed (95 %)",
            "false per frame (95 %)",
            "switches per run (95 %)",
            "flawless runs",
            "found after",
            "purity",
            "complete",
            "GOSPA m",
            "NEES (95 %)",
            "us per frame",
            "prototype",
        ]);
        for result in &self.experiments {
            let first = std::iter::once(result.number.to_string());
            let labels = first.chain(std::iter::repeat(String::new()));
            table.add_rows(labels.zip(&result.trackers).map(|(label, one)| row(label, one)));
        }
        for column in 2..16 {
            if let Some(column) = table.column_mut(column) {
                column.set_cell_alignment(CellAlignment::Right);
            }
        }
        format!("{}\n{table}\n{}", self.title(), self.notes())
    }

    fn json(&self) -> anyhow::Result<String> {
        document(self, self.bars())
    }

    fn write(&self, folder: &Path) -> anyhow::Result<()> {
        write(folder, "montecarlo.json", self.json()?.as_bytes())?;
        for result in &self.experiments {
            draw(&Page::of(self, result), folder, &format!("experiment-{}", result.number))?;
        }
        Ok(())
    }
}

impl Report {
    /// The bars of the default tracker; none if it did not take part.
    pub(super) fn bars(&self) -> Vec<Bar> {
        let judged = self.experiments.iter().filter_map(|result| {
            let ours = result.trackers.iter().find(|one| one.summary.tracker == JUDGED)?;
            Some(bar(result, &bounds(result.number), &ours.summary.figures))
        });
        judged.collect()
    }

    fn title(&self) -> String {
        let Self { trial_count, seed, snr_db, elapsed_s, .. } = self;
        format!(
            "mean-shift experiments, {snr_db} dB in the image, {trial_count} trials, seed {seed}, {elapsed_s:.1} s"
        )
    }

    fn notes(&self) -> String {
        let Settings { gate_m, allowance_s, gospa_cutoff_m, .. } = self.settings;
        let mut notes = format!(
            "followed: a confirmed track within {gate_m} m of the body's middle; missed: from \
             {allowance_s} s on. near side: RMSE against the mean of what reflects; smoothed: RMSE of \
             places known with what came within 1 s after. flawless: none missed, false or switched. GOSPA: p 2, alpha 2, \
             c {gospa_cutoff_m} m, from the first frame on. NEES: 2 if the covariance is true\n\
             prototype: RMSE m / missed / false per frame / switches per run, on people and a chain \
             of its own\n"
        );
        for result in &self.experiments {
            notes += &format!("{}: {:.1} s\n", result.label, result.took_s);
        }
        notes + &self.bars().iter().map(Bar::line).collect::<String>()
    }
}

fn bar(result: &SceneResult, bounds: &Bounds, figures: &Figures) -> Bar {
    let value = |figure: Option<Figure>| figure.map_or(f64::INFINITY, |figure| figure.value);
    let pairs = [
        ("RMSE", value(figures.rmse_m), bounds.rmse_m),
        ("missed", value(figures.missed_share), bounds.missed_share),
        ("false", value(figures.false_per_frame), bounds.false_per_frame),
        ("switches", value(figures.switches_per_run), bounds.switches_per_run),
    ];
    let part = |(what, got, most): (&str, f64, f64)| format!("{what} {got:.4}, at most {most}");
    let mut text = format!("{}: {}", result.label, pairs.map(part).join("; "));
    let mut is_met = pairs.iter().all(|(_, got, most)| got <= most);
    if let Some([least, most]) = bounds.nees {
        let nees = value(figures.nees);
        text += &format!("; NEES {nees:.2}, {least} to {most}");
        is_met &= (least..=most).contains(&nees);
    }
    Bar { text, is_met }
}

fn row(label: String, one: &TrackerResult) -> Vec<String> {
    let TrackerResult { summary, prototype, .. } = one;
    let Figures { rmse_m, missed_share, false_per_frame, switches_per_run, .. } = summary.figures;
    let figures = &summary.figures;
    let text = |figure: Option<Figure>, digits: usize| {
        figure.map_or_else(String::new, |figure| figure.text(digits))
    };
    let value = |figure: Option<Figure>, digits: usize, unit: &str| {
        figure.map_or_else(String::new, |Figure { value, .. }| format!("{value:.digits$}{unit}"))
    };
    vec![
        label,
        summary.tracker.to_owned(),
        text(rmse_m, 3),
        value(figures.near_side_rmse_m, 3, ""),
        value(figures.smoothed_rmse_m, 3, ""),
        text(missed_share, 3),
        text(false_per_frame, 3),
        text(switches_per_run, 2),
        format!("{}/{}", figures.flawless.count, figures.flawless.of),
        value(figures.initiation_delay_s, 2, " s"),
        value(figures.purity, 3, ""),
        value(figures.completeness, 3, ""),
        value(figures.gospa_m, 3, ""),
        text(figures.nees, 2),
        summary.track_us.map_or_else(String::new, |us| format!("{us:.0}")),
        prototype.unwrap_or_default().to_owned(),
    ]
}
