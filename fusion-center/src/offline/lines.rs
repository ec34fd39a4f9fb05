//! The lines of an input, with progress.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use indicatif::{ProgressBar, ProgressStyle};

/// Problems under way at once: enough to keep all cores busy, few enough to hold.
const PROBLEM_COUNT: u32 = 256;
/// Longest line, bytes: a thousand nodes with a thousand periods of several points.
const MAX_LINE_BYTES: u64 = 1 << 30;

/// One line of the input.
pub(super) struct Line {
    pub(super) number: u64,
    pub(super) text: String,
    /// Its length with that of the blank lines before it.
    pub(super) byte_count: u64,
}

impl Line {
    /// Room for lines under way, bytes.
    pub(super) const ROOM: u32 = 1 << 24;

    /// How much of the room it takes: its length, and never so little that too many are under way.
    pub(super) fn room(&self) -> u32 {
        let length = u32::try_from(self.text.len()).unwrap_or(u32::MAX);
        length.clamp(Self::ROOM / PROBLEM_COUNT, Self::ROOM)
    }
}

/// The input.
pub(super) struct Lines {
    input: Box<dyn BufRead + Send>,
    path: PathBuf,
    next_number: u64,
    bar: ProgressBar,
}

impl Lines {
    /// Of a file, or of standard input (`-`).
    pub(super) fn open(path: &Path) -> anyhow::Result<Self> {
        let (input, length): (Box<dyn BufRead + Send>, Option<u64>) = if path == Path::new("-") {
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

    /// Shows how far the answers are.
    pub(super) fn bar(&self) -> ProgressBar {
        self.bar.clone()
    }

    /// The next line that is not blank.
    pub(super) fn next_filled(&mut self) -> anyhow::Result<Option<Line>> {
        let mut blank_count = 0;
        while let Some(mut line) = self.next()? {
            line.byte_count += blank_count;
            if !line.text.trim().is_empty() {
                return Ok(Some(line));
            }
            blank_count = line.byte_count;
        }
        Ok(None)
    }

    fn next(&mut self) -> anyhow::Result<Option<Line>> {
        let number = self.next_number;
        let place = || format!("{}, line {number}", self.path.display());
        let mut text = Vec::new();
        let read = self.input.by_ref().take(MAX_LINE_BYTES).read_until(b'\n', &mut text);
        let byte_count = read.with_context(place)? as u64;
        if byte_count == MAX_LINE_BYTES {
            bail!("{}: longer than {MAX_LINE_BYTES} bytes: is this a file of JSON Lines?", place());
        }
        self.next_number += 1;
        // What is no UTF-8 is no JSON either, and the parser says where.
        let text = String::from_utf8_lossy(&text).into_owned();
        Ok((0 < byte_count).then_some(Line { number, text, byte_count }))
    }
}
