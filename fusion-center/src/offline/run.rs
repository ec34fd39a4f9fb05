//! From an input to answers: problems in parallel, answers in order.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use anyhow::{Context, bail};
use indicatif::{ProgressBar, ProgressStyle};
use proto::geom::{Node, Point};
use proto::ids::NodeId;
use proto::process;
use rayon::prelude::*;
use serde::Serialize;
use tokio_util::sync::CancellationToken;

use super::Answer;
use super::draw::{COLORS, Layer, picture};
use super::input::{Asked, points_of, read_folder, read_problem};
use crate::network::{SiteProblem, SiteSolution, solve_site};
use crate::registration::{Known, Problem, Solution, Solver};
use crate::service::Clock;

/// Problems read ahead: enough to keep all cores busy, few enough to hold.
const BATCH_COUNT: usize = 256;
/// Longest part of a problem's name in that of a file.
const LONGEST_NAME: usize = 100;
/// A batch ends early at this size, bytes.
const BATCH_BYTES: usize = 1 << 24;
/// Longest line, bytes: a thousand nodes with a thousand periods of several points.
const MAX_LINE_BYTES: u64 = 1 << 30;

/// What is asked for.
#[derive(Clone, Debug)]
pub struct Options {
    /// A file of JSON Lines, `-` for standard input, or a folder of points.
    pub input: PathBuf,
    /// The reference of a folder's problem.
    pub reference: Option<NodeId>,
    /// Answer in JSON Lines instead of a table.
    pub json: bool,
    /// Where pictures go.
    pub figures: Option<PathBuf>,
}

/// A line without an answer.
#[derive(Serialize)]
struct Failed {
    line: u64,
    error: String,
}

/// One line of the input.
struct Line {
    number: u64,
    text: String,
}

/// An answer with its pictures, by part.
struct Drawn {
    answer: Answer,
    pictures: Vec<(&'static str, String)>,
}

type Answered = Result<Drawn, Failed>;

/// Registers every problem of the input and prints the answers.
///
/// # Errors
/// If the input cannot be read, or in the end if any line had to be left out.
pub fn register(
    options: &Options,
    solver: &dyn Solver,
    stop: &CancellationToken,
) -> anyhow::Result<()> {
    if let Some(folder) = &options.figures {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("creating --figures {}", folder.display()))?;
    }
    let figures = options.figures.clone();
    let mut output = Output { json: options.json, figures, ..Output::default() };
    if options.input.is_dir() {
        let asked = read_folder(&options.input, options.reference.clone())?;
        output.take(&[Ok(answer(options, solver, asked)?)])?;
        return output.finish();
    }
    if options.reference.is_some() {
        bail!("--reference is for a folder: in JSON Lines every problem names its own");
    }
    let mut lines = Lines::open(&options.input)?;
    let name = options.input.display().to_string();
    while !stop.is_cancelled() {
        let batch = lines.batch()?;
        if batch.is_empty() {
            break;
        }
        let answers: Vec<Answered> =
            batch.par_iter().map(|line| of_line(options, solver, &name, line)).collect();
        output.take(&answers)?;
    }
    lines.bar.finish_and_clear();
    output.finish()?;
    if stop.is_cancelled() {
        bail!(
            "stopped before the end of {}: the answers so far are complete",
            options.input.display()
        );
    }
    Ok(())
}

fn of_line(options: &Options, solver: &dyn Solver, name: &str, line: &Line) -> Answered {
    let number = line.number;
    let place = format!("{name}, line {number}");
    let asked = read_problem(&place, &line.text).map_err(anyhow::Error::from);
    let answered = asked.and_then(|asked| answer(options, solver, asked));
    answered.map_err(|error| Failed { line: number, error: process::explained(&error) })
}

fn answer(options: &Options, solver: &dyn Solver, asked: Asked) -> anyhow::Result<Drawn> {
    let timed = Timed { solver, total_ns: AtomicU64::new(0) };
    let solution = solve_site(&asked.problem, &timed);
    let solve_us = timed.total_ns.into_inner() as f64 * 1e-3;
    let is_wanted = options.figures.is_some();
    let pictures = if is_wanted { pictures(&asked, &solution)? } else { Vec::new() };
    Ok(Drawn { answer: Answer::new(asked, &solution, solve_us), pictures })
}

/// A solver that adds up how long it takes: a thread that waits for one problem works at others, so
/// the time from the start of a problem to its end would hold theirs.
struct Timed<'a> {
    solver: &'a dyn Solver,
    total_ns: AtomicU64,
}

impl Solver for Timed<'_> {
    fn name(&self) -> &'static str {
        self.solver.name()
    }

    fn solve(&self, problem: &Problem, known: Option<&Known>) -> Solution {
        let clock = Clock::start();
        let start = clock.now();
        let solution = self.solver.solve(problem, known);
        let taken_ns = clock.now().since(start).as_nanos();
        self.total_ns.fetch_add(u64::try_from(taken_ns).unwrap_or(u64::MAX), Ordering::Relaxed);
        solution
    }
}

/// Lines of the input with progress.
struct Lines {
    input: Box<dyn BufRead>,
    path: PathBuf,
    next_number: u64,
    bar: ProgressBar,
}

impl Lines {
    fn open(path: &Path) -> anyhow::Result<Self> {
        let (input, length): (Box<dyn BufRead>, Option<u64>) = if path == Path::new("-") {
            (Box::new(BufReader::new(std::io::stdin())), None)
        } else {
            let file = File::open(path).with_context(|| format!("reading {}", path.display()))?;
            let length = file.metadata().ok().map(|about| about.len());
            (Box::new(BufReader::new(file)), length)
        };
        let template = "{bar:24} {bytes}/{total_bytes}, {eta} left, {msg}";
        let style = ProgressStyle::with_template(template);
        let bar = length.map_or_else(ProgressBar::no_length, ProgressBar::new);
        let bar = bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        Ok(Self { input, path: path.to_owned(), next_number: 1, bar })
    }

    /// The next lines that are not blank.
    fn batch(&mut self) -> anyhow::Result<Vec<Line>> {
        let mut batch = Vec::new();
        let mut byte_count = 0;
        while batch.len() < BATCH_COUNT && byte_count < BATCH_BYTES {
            let Some(line) = self.line()? else { break };
            byte_count += line.text.len();
            if !line.text.trim().is_empty() {
                batch.push(line);
            }
        }
        self.bar.set_message(format!("{} problems", self.next_number - 1));
        Ok(batch)
    }

    fn line(&mut self) -> anyhow::Result<Option<Line>> {
        let number = self.next_number;
        let place = || format!("{}, line {number}", self.path.display());
        let mut text = Vec::new();
        let read = self.input.by_ref().take(MAX_LINE_BYTES).read_until(b'\n', &mut text);
        let count = read.with_context(place)?;
        if count as u64 == MAX_LINE_BYTES {
            bail!("{}: longer than {MAX_LINE_BYTES} bytes: is this a file of JSON Lines?", place());
        }
        self.next_number += 1;
        self.bar.inc(count as u64);
        // What is no UTF-8 is no JSON either, and the parser says where.
        let text = String::from_utf8_lossy(&text).into_owned();
        Ok((0 < count).then_some(Line { number, text }))
    }
}

/// Prints answers as they come, or a table at the end.
#[derive(Default)]
struct Output {
    json: bool,
    figures: Option<PathBuf>,
    file_names: BTreeSet<String>,
    rows: Vec<Vec<String>>,
    failed: Vec<String>,
    undrawn: Vec<String>,
    count: usize,
}

impl Output {
    fn take(&mut self, answers: &[Answered]) -> anyhow::Result<()> {
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

    fn finish(self) -> anyhow::Result<()> {
        if !self.json {
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

/// Part `before`: every node's points in its own frame; part `after`: those of the nodes that were
/// registered, in the reference's.
fn pictures(asked: &Asked, solution: &SiteSolution) -> anyhow::Result<Vec<(&'static str, String)>> {
    let id = shown(&asked.id);
    let parts = [("before", before(&asked.problem)), ("after", after(&asked.problem, solution))];
    let draw = |(part, layers): (&'static str, Vec<Layer>)| {
        let svg = picture(&format!("{id}: {part} registration"), &layers)
            .map_err(|error| anyhow::anyhow!("drawing {id}: {error}"))?;
        Ok((part, svg))
    };
    parts.into_iter().map(draw).collect()
}

fn shown(id: &serde_json::Value) -> String {
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

fn before(problem: &SiteProblem) -> Vec<Layer> {
    let layer = |(index, (node, view)): (usize, (&NodeId, &crate::network::NodeView))| Layer {
        label: node.to_string(),
        color: COLORS[index % COLORS.len()],
        points_m: points_of(view).map(Into::into).collect(),
        estimated: None,
        truth: None,
    };
    problem.views.iter().enumerate().map(layer).collect()
}

fn after(problem: &SiteProblem, solution: &SiteSolution) -> Vec<Layer> {
    let group = solution.groups.iter().find(|group| group.gauge == problem.reference);
    let mut layers = before(problem);
    for (layer, (node, view)) in layers.iter_mut().zip(&problem.views) {
        let placed = group.and_then(|group| group.nodes.get(node));
        let Some(placed) = placed else {
            layer.points_m.clear();
            layer.label.push_str(" (not registered)");
            continue;
        };
        let pose = placed.estimate.pose_ref_from_node;
        let mapped = points_of(view).map(|at| pose * Point::<Node>::from_coords(at));
        layer.points_m = mapped.map(|point| [point.x_m(), point.y_m()]).collect();
        layer.estimated = Some(pose);
    }
    layers
}
