//! What the trials indoors leave: a table and one JSON document.

use std::path::Path;

use comfy_table::Table;
use comfy_table::presets::UTF8_HORIZONTAL_ONLY;
use serde::Serialize;

use super::super::Results;
use super::super::mean_shift::summary::Figures;
use super::super::sheet::{Bar, document, write};
use super::super::statistics::{Figure, Proportion};
use super::trial::Outcome;
use super::{LONGEST_FALSE_S, Settings};

/// Bars of the office: root mean square distance, and the share of runs without a switch.
const MAX_RMSE_M: f64 = 0.12;
const MIN_STEADY_SHARE: f64 = 0.9;

/// Everything the trials have shown.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Report {
    pub(super) scenario: String,
    pub(super) seed: u64,
    pub(super) trial_count: usize,
    pub(super) settings: Settings,
    pub(super) figures: Figures,
    /// Trials in which everybody kept one identity.
    pub(super) without_switch: Proportion,
    /// Trials in which no track was with nobody for long.
    pub(super) without_long_false: Proportion,
    pub(super) outcomes: Vec<Outcome>,
    /// How long all of it took, seconds. Differs from run to run.
    pub(super) elapsed_s: f64,
}

impl Results for Report {
    fn table(&self) -> String {
        let mut table = Table::new();
        table.load_style(UTF8_HORIZONTAL_ONLY).set_header(["figure", "value (95 %)"]);
        for (name, value) in self.rows() {
            table.add_row([name.to_owned(), value]);
        }
        let Self { scenario, trial_count, seed, elapsed_s, .. } = self;
        let mut text = format!(
            "people at the centre: {scenario}, {trial_count} trials, first seed {seed}, \
             {elapsed_s:.1} s\n{table}\n"
        );
        let Settings { gate_m, allowance_s, gospa_cutoff_m, .. } = self.settings;
        text += &format!(
            "scored from the first confirmed person on; followed: within {gate_m} m of the body's \
             middle; missed: from {allowance_s} s on; GOSPA: p 2, alpha 2, c {gospa_cutoff_m} m; \
             NEES: 2 if the covariance is true\n"
        );
        text + &self.bars().iter().map(Bar::line).collect::<String>()
    }

    fn json(&self) -> anyhow::Result<String> {
        document(self, self.bars())
    }

    fn write(&self, folder: &Path) -> anyhow::Result<()> {
        write(folder, "montecarlo.json", self.json()?.as_bytes())
    }
}

impl Report {
    /// The bars; none for other scenarios than the office.
    pub(super) fn bars(&self) -> Vec<Bar> {
        if self.scenario != "office" {
            return Vec::new();
        }
        let rmse_m = self.figures.rmse_m.map_or(f64::INFINITY, |figure| figure.value);
        let steady = self.without_switch.share;
        let clean = self.without_long_false;
        let bar = |text: String, is_met| Bar { text, is_met };
        vec![
            bar(format!("localisation {rmse_m:.3} m, at most {MAX_RMSE_M}"), rmse_m <= MAX_RMSE_M),
            bar(
                format!("no switch in {steady:.2} of the runs, at least {MIN_STEADY_SHARE}"),
                MIN_STEADY_SHARE <= steady,
            ),
            bar(
                format!(
                    "no false track longer than {LONGEST_FALSE_S} s in {} of {} runs, all wanted",
                    clean.count, clean.of
                ),
                clean.count == clean.of,
            ),
        ]
    }

    fn rows(&self) -> Vec<(&'static str, String)> {
        let text = |figure: Option<Figure>, digits: usize| {
            figure.map_or_else(|| "none".to_owned(), |figure| figure.text(digits))
        };
        let figures = &self.figures;
        let starts: Vec<f64> = self.outcomes.iter().filter_map(|one| one.first_s).collect();
        let mean_s = starts.iter().sum::<f64>() / starts.len().max(1) as f64;
        let longest_s = self.outcomes.iter().map(|one| one.longest_false_s).fold(0.0, f64::max);
        vec![
            ("localisation, RMS per person, m", text(figures.rmse_m, 3)),
            ("missed", text(figures.missed_share, 3)),
            ("false per period", text(figures.false_per_frame, 3)),
            ("switches per run", text(figures.switches_per_run, 2)),
            ("runs without a switch", self.without_switch.text()),
            ("longest false track, s", format!("{longest_s:.1}")),
            ("runs without a long false track", self.without_long_false.text()),
            ("purity", text(figures.purity, 3)),
            ("completeness", text(figures.completeness, 3)),
            ("GOSPA, m", text(figures.gospa_m, 3)),
            ("NEES of the position", text(figures.nees, 2)),
            ("first person followed after, s", format!("{mean_s:.1} ({} runs)", starts.len())),
        ]
    }
}
