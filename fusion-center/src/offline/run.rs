//! From an input to answers: problems in parallel, answers in order.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use anyhow::{Context, bail};
use chart::{Sheet, color};
use proto::geom::{Node, Point};
use proto::ids::NodeId;
use proto::process;
use tokio::runtime::Handle;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc};
use tokio_util::sync::CancellationToken;

use super::Answer;
use super::draw::{Layer, Site};
use super::input::{Asked, points_of, read_folder, read_problem};
use super::lines::{Line, Lines};
use super::output::{Answered, Drawn, Failed, Output, shown};
use crate::network::{SiteProblem, SiteSolution, solve_site};
use crate::registration::{Known, Problem, Solution, Solver};
use crate::service::Clock;

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

/// Registers every problem of the input and prints the answers, each as soon as it and all before it
/// are there.
///
/// # Errors
/// If the input cannot be read, if `stop` was called before its end, or in the end if any line had to
/// be left out. Answers that were complete by then are printed.
pub async fn register(
    options: Options,
    solver: Arc<dyn Solver>,
    stop: &CancellationToken,
) -> anyhow::Result<()> {
    if let Some(folder) = &options.figures {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("creating --figures {}", folder.display()))?;
    }
    let mut output = Output::new(&options);
    let name = options.input.display().to_string();
    let task = Arc::new(Task { options, solver, name });
    if task.options.input.is_dir() {
        let work = tokio::task::spawn_blocking(move || of_folder(&task));
        let drawn = tokio::select! {
            () = stop.cancelled() => bail!("stopped before the answer"),
            drawn = work => drawn.context("registering a folder")??,
        };
        output.take(&[Ok(drawn)])?;
        return output.finish();
    }
    if task.options.reference.is_some() {
        bail!("--reference is for a folder: in JSON Lines every problem names its own");
    }
    let result = follow(&task, &mut output, stop).await;
    // What is complete is kept, whatever ended the input.
    let finished = output.finish();
    result.and(finished)
}

/// What the threads share.
struct Task {
    options: Options,
    solver: Arc<dyn Solver>,
    name: String,
}

/// The answer to one line, by its place among the lines.
struct Done {
    index: u64,
    byte_count: u64,
    answered: Answered,
    /// Room for another line, once this answer is out.
    _room: OwnedSemaphorePermit,
}

/// Takes answers in their order until the input ends or `stop` is called. Reading and solving go on
/// beside it: neither a slow solver nor an input that stays open keeps the program from ending.
async fn follow(
    task: &Arc<Task>,
    output: &mut Output,
    stop: &CancellationToken,
) -> anyhow::Result<()> {
    let lines = Lines::open(&task.options.input)?;
    let bar = lines.bar();
    // Bounded by the room that each answer holds.
    let (sender, mut done) = mpsc::unbounded_channel();
    let (shared, runtime) = (Arc::clone(task), Handle::current());
    let reading = tokio::task::spawn_blocking(move || read_all(&shared, lines, &runtime, &sender));
    let mut order = InOrder::default();
    loop {
        let first = tokio::select! {
            biased;
            () = stop.cancelled() => {
                bar.finish_and_clear();
                bail!("stopped before the end of {}: the answers so far are complete", task.name);
            }
            first = done.recv() => first,
        };
        let Some(first) = first else { break };
        order.take(std::iter::once(first).chain(std::iter::from_fn(|| done.try_recv().ok())));
        let (answers, byte_count) = order.ready();
        bar.inc(byte_count);
        bar.set_message(format!("{} problems", order.next_index));
        output.take(&answers)?;
    }
    bar.finish_and_clear();
    reading.await.context("reading the input")?
}

/// Reads all lines and hands each to the workers as soon as there is room for it.
fn read_all(
    task: &Arc<Task>,
    mut lines: Lines,
    runtime: &Handle,
    done: &mpsc::UnboundedSender<Done>,
) -> anyhow::Result<()> {
    let rooms = Arc::new(Semaphore::new(Line::ROOM as usize));
    let mut index = 0;
    while let Some(line) = lines.next_filled()? {
        let room = runtime.block_on(Arc::clone(&rooms).acquire_many_owned(line.room()))?;
        let (shared, sender) = (Arc::clone(task), done.clone());
        rayon::spawn(move || {
            let (byte_count, answered) = (line.byte_count, of_line(&shared, &line));
            // Nobody takes it once the program ends.
            drop(sender.send(Done { index, byte_count, answered, _room: room }));
        });
        index += 1;
    }
    Ok(())
}

/// Answers that wait for those before them.
#[derive(Default)]
struct InOrder {
    waiting: BTreeMap<u64, Done>,
    next_index: u64,
}

impl InOrder {
    fn take(&mut self, arrived: impl Iterator<Item = Done>) {
        self.waiting.extend(arrived.map(|one| (one.index, one)));
    }

    /// The answers whose turn it is, and how many bytes of the input they are about.
    fn ready(&mut self) -> (Vec<Answered>, u64) {
        let (mut answers, mut byte_count) = (Vec::new(), 0);
        while let Some(one) = self.waiting.remove(&self.next_index) {
            byte_count += one.byte_count;
            answers.push(one.answered);
            self.next_index += 1;
        }
        (answers, byte_count)
    }
}

fn of_folder(task: &Task) -> anyhow::Result<Drawn> {
    let Options { input, reference, .. } = &task.options;
    answer(task, read_folder(input, reference.clone())?)
}

fn of_line(task: &Task, line: &Line) -> Answered {
    let number = line.number;
    let place = format!("{}, line {number}", task.name);
    let asked = read_problem(&place, &line.text).map_err(anyhow::Error::from);
    let answered = asked.and_then(|asked| answer(task, asked));
    answered.map_err(|error| Failed { line: number, error: process::explained(&error) })
}

fn answer(task: &Task, asked: Asked) -> anyhow::Result<Drawn> {
    let timed = Timed { solver: task.solver.as_ref(), total_ns: AtomicU64::new(0) };
    let solution = solve_site(&asked.problem, &timed);
    let solve_us = timed.total_ns.into_inner() as f64 * 1e-3;
    let is_wanted = task.options.figures.is_some();
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

/// Part `before`: every node's points in its own frame; part `after`: those of the nodes that were
/// registered, in the reference's.
fn pictures(asked: &Asked, solution: &SiteSolution) -> anyhow::Result<Vec<(&'static str, String)>> {
    let id = shown(&asked.id);
    let parts = [("before", before(&asked.problem)), ("after", after(&asked.problem, solution))];
    let draw = |(part, layers): (&'static str, Vec<Layer>)| {
        let site = Site { title: format!("{id}: {part} registration"), layers };
        let svg = site.svg().map_err(|error| anyhow::anyhow!("drawing {id}: {error}"))?;
        Ok((part, svg))
    };
    parts.into_iter().map(draw).collect()
}

fn before(problem: &SiteProblem) -> Vec<Layer> {
    let layer = |(index, (node, view)): (usize, (&NodeId, &crate::network::NodeView))| Layer {
        label: node.to_string(),
        color: color(index),
        points_m: points_of(view).map(Into::into).collect(),
        estimated: None,
        truth: None,
        ways: Vec::new(),
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

#[cfg(test)]
mod tests;
