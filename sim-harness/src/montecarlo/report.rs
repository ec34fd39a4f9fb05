//! What an experiment leaves: a table, one JSON document, pictures.

use std::path::Path;

use comfy_table::presets::UTF8_HORIZONTAL_ONLY;
use comfy_table::{CellAlignment, Table};
use serde::Serialize;

use super::Results;
use super::picture::Page;
use super::score::{MethodScore, Reach};
use super::sheet::{Bar, document, draw, write};
use super::{ConditionResult, Figure, Level};

/// The solver that must reach the bars.
const JUDGED: &str = "default";
/// Bars of our own solver: share in the paper's box from echoes with the literal noise, ratio to the
/// bound with the physical noise, mean errors in the measured room.
const BAR_IN_BOX: f64 = 0.97;
const BAR_OVER_BOUND: f64 = 1.25;
const BAR_ROOM_POSITION_M: f64 = 0.10;
const BAR_ROOM_ANGLE_DEG: f64 = 1.5;

/// Everything an experiment has shown.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Report {
    pub(super) figure: Figure,
    pub(super) level: Level,
    /// Of the echoes.
    pub(super) scenario: Option<String>,
    pub(super) seed: u64,
    pub(super) trial_count: usize,
    pub(super) reach: Reach,
    pub(super) conditions: Vec<ConditionResult>,
    /// How long all of it took, seconds. Differs from run to run.
    pub(super) elapsed_s: f64,
}

impl Results for Report {
    fn table(&self) -> String {
        let mut table = Table::new();
        table.load_style(UTF8_HORIZONTAL_ONLY).set_header([
            "condition",
            "method",
            "in box (95 %)",
            "determined (95 %)",
            "of these in box (95 %)",
            "gross",
            "mean position",
            "mean angle",
            "RMSE / bound",
            "NEES",
            "solve",
        ]);
        for result in &self.conditions {
            let first = std::iter::once(result.condition.label);
            let labels = first.chain(std::iter::repeat(""));
            table.add_rows(labels.zip(&result.methods).map(|(label, method)| row(label, method)));
        }
        for column in 2..11 {
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
        draw(&Page::of(self), folder, "errors")
    }
}

impl Report {
    /// The bars that the figure sets the default solver; none if it did not take part, and none for
    /// points and scenarios of one's own.
    pub(super) fn bars(&self) -> Vec<Bar> {
        let judged = || {
            self.conditions.iter().filter_map(|result| {
                let ours = result.methods.iter().find(|method| method.method == JUDGED)?;
                Some((result.condition.label, ours))
            })
        };
        let scenario = self.scenario.as_deref();
        match (self.figure, scenario) {
            (Figure::Fig10, _) => judged().map(|(label, ours)| room_bar(label, ours)).collect(),
            (Figure::Fig6 | Figure::Fig7, Some("paper-physical")) => {
                judged().map(|(label, ours)| bound_bar(label, ours)).collect()
            }
            (Figure::Fig6 | Figure::Fig7, Some("paper")) => {
                judged().map(|(label, ours)| box_bar(label, ours)).collect()
            }
            (Figure::Fig6 | Figure::Fig7, _) => Vec::new(),
        }
    }

    fn title(&self) -> String {
        let Self { trial_count, seed, elapsed_s, .. } = self;
        let data = self.scenario.as_deref().map_or_else(
            || "points".to_owned(),
            |scenario| format!("echoes of scenario {scenario}"),
        );
        let figure = self.figure_number();
        format!("figure {figure}, {data}, {trial_count} trials, seed {seed}, {elapsed_s:.1} s")
    }

    fn figure_number(&self) -> u32 {
        match self.figure {
            Figure::Fig6 => 6,
            Figure::Fig7 => 7,
            Figure::Fig10 => 10,
        }
    }

    fn notes(&self) -> String {
        let mut notes = String::from(
            "box: position < 0.05 m and angle < 1 deg. gross, RMSE / bound (position, heading) and \
             NEES (3 if the covariance is true): of the determined; gross: > 1 m or > 15 deg\n",
        );
        for result in &self.conditions {
            let ([in_ref, in_node], took_s) = (result.points_per_period, result.simulate_s);
            notes += &format!(
                "{}: published: {}; {in_ref:.2} and {in_node:.2} points per period; simulated in \
                 {took_s:.1} s\n",
                result.condition.label, result.condition.published
            );
        }
        notes + &self.bars().iter().map(Bar::line).collect::<String>()
    }

    /// Heading of the picture.
    pub(super) fn heading(&self) -> String {
        let level = self.scenario.as_deref().map_or("points", |scenario| scenario);
        let (figure, trial_count, seed) = (self.figure_number(), self.trial_count, self.seed);
        format!("Figure {figure} ({level}): {trial_count} trials, seed {seed}")
    }
}

fn box_bar(label: &str, ours: &MethodScore) -> Bar {
    let text = format!("{label}: share in box {:.3}, at least {BAR_IN_BOX}", ours.in_box.share);
    Bar { text, is_met: BAR_IN_BOX <= ours.in_box.share }
}

fn bound_bar(label: &str, ours: &MethodScore) -> Bar {
    let Some([position, heading]) = ours.rmse_over_bound else {
        return Bar { text: format!("{label}: no bound"), is_met: false };
    };
    let text =
        format!("{label}: RMSE / bound {position:.2} and {heading:.2}, at most {BAR_OVER_BOUND}");
    Bar { text, is_met: position.max(heading) <= BAR_OVER_BOUND }
}

/// Every trial must have named a pose: a mean over the easy ones proves nothing.
fn room_bar(label: &str, ours: &MethodScore) -> Bar {
    let silent_count = ours.trials.iter().filter(|trial| trial.error.is_none()).count();
    let (Some(position_m), Some(angle_deg)) = (ours.position_m.mean, ours.angle_deg.mean) else {
        return Bar { text: format!("{label}: no pose in any trial"), is_met: false };
    };
    let text = format!(
        "{label}: mean error {position_m:.3} m and {angle_deg:.2} deg, at most \
         {BAR_ROOM_POSITION_M} m and {BAR_ROOM_ANGLE_DEG} deg; {silent_count} trials without a pose"
    );
    let is_precise = position_m <= BAR_ROOM_POSITION_M && angle_deg <= BAR_ROOM_ANGLE_DEG;
    Bar { text, is_met: is_precise && silent_count == 0 }
}

fn row(label: &str, method: &MethodScore) -> Vec<String> {
    let proportion = |p: &Option<super::statistics::Proportion>| {
        p.as_ref().map_or_else(String::new, super::statistics::Proportion::text)
    };
    let number = |value: Option<f64>, digits: usize, unit: &str| {
        value.map_or_else(String::new, |value| format!("{value:.digits$}{unit}"))
    };
    let ratio = method
        .rmse_over_bound
        .map_or_else(String::new, |[position, heading]| format!("{position:.2}, {heading:.2}"));
    let gross = method.gross_of_determined.map_or_else(String::new, |p| p.count.to_string());
    vec![
        label.to_owned(),
        method.method.clone(),
        method.in_box.text(),
        proportion(&method.determined),
        proportion(&method.in_box_of_determined),
        gross,
        number(method.position_m.mean, 4, " m"),
        number(method.angle_deg.mean, 3, " deg"),
        ratio,
        number(method.mean_normalised_error, 2, ""),
        number(method.solve_ms, 3, " ms"),
    ]
}
