//! The table of a run: the median of every benchmark that was measured, from criterion's estimates.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use serde_json::Value;

/// The benchmark all images are compared with.
const REFERENCE: &str = "back_projection/textbook";
/// Groups whose work holds that of the reference.
const COMPARED: [&str; 2] = ["back_projection/", "chain/"];

/// One measured benchmark.
struct Row {
    measured_at: SystemTime,
    title: String,
    median_ms: f64,
}

/// Writes to `to` one Markdown table of what was measured after `since`; nothing if nothing was.
///
/// # Errors
/// If `to` takes no more.
pub(crate) fn write(to: &mut impl Write, since: SystemTime, kernel: &str) -> io::Result<()> {
    let rows = rows(since);
    if rows.is_empty() {
        return Ok(());
    }
    let thread_count = std::thread::available_parallelism().map_or(1, usize::from);
    let reference_ms = rows.iter().find(|row| row.title == REFERENCE).map(|row| row.median_ms);
    writeln!(to, "\n{}, {thread_count} threads; kernel {kernel}\n", processor())?;
    writeln!(to, "| stage | median ms | times faster than the textbook's loop |")?;
    writeln!(to, "|---|---:|---:|")?;
    for Row { title, median_ms, .. } in &rows {
        let is_compared = COMPARED.iter().any(|group| title.starts_with(group));
        let ratio = reference_ms.filter(|_| is_compared && title != "chain/new");
        let times = ratio.map(|ms| format!("{:.1}", ms / median_ms)).unwrap_or_default();
        writeln!(to, "| {title} | {median_ms:.3} | {times} |")?;
    }
    Ok(())
}

/// What was measured after `since`, in that order.
fn rows(since: SystemTime) -> Vec<Row> {
    let groups = criterion_folder().map(|folder| folders_in(&folder)).unwrap_or_default();
    let benchmarks = groups.iter().flat_map(|group| folders_in(group));
    let mut rows: Vec<Row> = benchmarks
        .filter_map(|benchmark| row(&benchmark.join("new")))
        .filter(|row| since <= row.measured_at)
        .collect();
    rows.sort_by_key(|row| row.measured_at);
    rows
}

/// The estimates in `folder`; `None` if it holds none.
fn row(folder: &Path) -> Option<Row> {
    let estimates = folder.join("estimates.json");
    let measured_at = fs::metadata(&estimates).ok()?.modified().ok()?;
    let median_ns = json(&estimates)?["median"]["point_estimate"].as_f64()?;
    let title = json(&folder.join("benchmark.json"))?["full_id"].as_str()?.to_owned();
    Some(Row { measured_at, title, median_ms: 1e-6 * median_ns })
}

fn json(path: &Path) -> Option<Value> {
    serde_json::from_str(&fs::read_to_string(path).ok()?).ok()
}

fn folders_in(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).filter(|path| path.is_dir()).collect()
}

/// Where criterion writes: as it is told, or beside what was built.
#[expect(clippy::disallowed_methods, reason = "criterion takes its folder from these, too")]
fn criterion_folder() -> Option<PathBuf> {
    if let Ok(home) = std::env::var("CRITERION_HOME") {
        return Some(PathBuf::from(home));
    }
    if let Ok(target) = std::env::var("CARGO_TARGET_DIR") {
        return Some(Path::new(&target).join("criterion"));
    }
    let program = std::env::current_exe().ok()?;
    program.ancestors().map(|folder| folder.join("criterion")).find(|folder| folder.is_dir())
}

/// The processor's name where the system tells it, else its kind.
fn processor() -> String {
    let told = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = told.lines().find_map(|line| line.strip_prefix("model name")?.split(": ").nth(1));
    name.unwrap_or(std::env::consts::ARCH).to_owned()
}
