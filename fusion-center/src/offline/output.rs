//! Answers printed as they come, or as a table at the end; their pictures into files.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::PathBuf;

use anyhow::bail;
use proto::process;
use serde::Serialize;

use super::{Answer, Options};

/// Longest part of a problem's name in that of a file.
const LONGEST_NAME: usize = 100;

/// A line without an answer.
#[derive(Serialize)]
pub(super) struct Failed {
    pub(super) line: u64,
    pub(super) error: String,
}

/// An answer with its pictures, by part.
pub(super) struct Drawn {
    pub(super) answer: Answer,
    pub(super) pictures: Vec<(&'static str, String)>,
}

pub(super) type Answered = Result<Drawn, Failed>;

/// Prints answers as they come, or a table at the end.
#[derive(Default)]
pub(super) struct Output {
    json: bool,
    figures: Option<PathBuf>,
    file_names: BTreeSet<String>,
    rows: Vec<Vec<String>>,
    failed: Vec<String>,
    undrawn: Vec<String>,
    count: usize,
}

impl Output {
    /// As `options` ask for.
    pub(super) fn new(options: &Options) -> Self {
        Self { json: options.json, figures: options.figures.clone(), ..Self::default() }
    }

    /// Prints answers in JSON Lines, or keeps their rows for the table, and draws their pictures.
    pub(super) fn take(&mut self, answers: &[Answered]) -> anyhow::Result<()> {
        self.count += answers.len();
        let mut text = Vec::new();
        for answered in answers {
            if self.json {
                match answered {
                    Ok(drawn) => serde_json::to_writer(&mut text, &drawn.answer)?,
                    Err(failed) => serde_json::to_writer(&mut text, failed)?,
                }
                text.write_all(b"\n")?;
            } else if let Ok(Drawn { answer, .. }) = answered {
                self.rows.extend(answer.rows());
                answer.warn();
            }
            self.draw(answered);
        }
        let errors = answers.iter().filter_map(|answered| answered.as_ref().err());
        self.failed.extend(errors.map(|failed| failed.error.clone()));
        process::print(&String::from_utf8_lossy(&text))
    }

    /// Writes the pictures of an answer; one that cannot be written costs that picture only.
    fn draw(&mut self, answered: &Answered) {
        let (Some(folder), Ok(Drawn { answer, pictures })) = (&self.figures, answered) else {
            return;
        };
        let name = file_name(&answer.id, &mut self.file_names);
        for (part, svg) in pictures {
            let path = folder.join(format!("{name}.{part}.svg"));
            if let Err(error) = std::fs::write(&path, svg) {
                self.undrawn.push(format!("writing {}: {error}", path.display()));
            }
        }
    }

    /// Prints the table, and fails if any line had to be left out.
    pub(super) fn finish(self) -> anyhow::Result<()> {
        if !self.json && 0 < self.count {
            let mut table = comfy_table::Table::new();
            table.load_style(comfy_table::presets::UTF8_HORIZONTAL_ONLY);
            table.set_header(["problem", "node", "x y heading", "σ", "matched", "outcome"]);
            table.add_rows(self.rows);
            process::print(&format!("{table}\n"))?;
        }
        if self.count == 0 {
            bail!("the input holds no problem: one JSON object per line is expected");
        }
        if let (Some(first), true) = (self.undrawn.first(), self.failed.is_empty()) {
            bail!("{} pictures could not be written; the first: {first}", self.undrawn.len());
        }
        let Some(first) = self.failed.first() else { return Ok(()) };
        bail!(
            "{} of {} problems could not be read; the first: {first}",
            self.failed.len(),
            self.count
        )
    }
}

/// A problem's name as people read it.
pub(super) fn shown(id: &serde_json::Value) -> String {
    id.as_str().map_or_else(|| id.to_string(), ToOwned::to_owned)
}

/// A file name for a problem: its id without what file systems dislike, numbered where two are alike.
fn file_name(id: &serde_json::Value, used: &mut BTreeSet<String>) -> String {
    let is_plain = |letter: char| letter.is_ascii_alphanumeric() || "-_.".contains(letter);
    let id = shown(id);
    let plain = id.chars().map(|c| if is_plain(c) { c } else { '_' });
    let name: String = plain.take(LONGEST_NAME).collect();
    let numbered = (2_u64..).map(|number| format!("{name}-{number}"));
    let free = std::iter::once(name.clone()).chain(numbered).find(|name| !used.contains(name));
    let free = free.unwrap_or(name);
    used.insert(free.clone());
    free
}
