//! Where the periods of a recording go: points into a file, a text, a table.

use std::fmt::Write as _;
use std::io::{self, Write};
use std::path::Path;

use super::part::PartFile;
use crate::lines::PointsLine;
use crate::pipeline::Measured;

/// What is known of a recording before its first period.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beginning {
    /// Periods that will come, unless the recording is damaged.
    pub period_count: u64,
    /// Time from the first to the second, seconds.
    pub period_s: f64,
}

/// A period as the chain measured it.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// Its count.
    pub period: u64,
    /// When, in the recording's own time.
    pub time_s: f64,
    /// Points and image.
    pub measured: &'a Measured<'a>,
}

/// Takes one period after the other.
pub trait PeriodSink {
    /// What it makes of them, for messages.
    fn product(&self) -> &'static str {
        "points"
    }

    /// Prepares for a recording.
    ///
    /// # Errors
    /// If something cannot be written.
    fn begin(&mut self, _beginning: &Beginning) -> io::Result<()> {
        Ok(())
    }

    /// Looks at the next period with its image, before [`Self::take`].
    ///
    /// # Errors
    /// If something cannot be written.
    fn see(&mut self, _seen: &Seen<'_>) -> io::Result<()> {
        Ok(())
    }

    /// Takes the points of the next period.
    ///
    /// # Errors
    /// If it cannot be written.
    fn take(&mut self, line: &PointsLine<'_>) -> io::Result<()>;

    /// Makes what was taken final.
    ///
    /// # Errors
    /// If it cannot be written.
    fn finish(&mut self) -> io::Result<()> {
        Ok(())
    }

    /// Keeps what was taken, as a part of what it should have become.
    ///
    /// # Errors
    /// If it cannot be written.
    fn abandon(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A file of JSON Lines: `NAME.part` until it is whole. What is no regular file, `/dev/null` for
/// example, is written as it is.
#[derive(Debug)]
pub struct LinesFile {
    file: PartFile,
}

impl LinesFile {
    /// Opens the file that will be `path`.
    ///
    /// # Errors
    /// If it cannot be created.
    pub fn create(path: &Path) -> io::Result<Self> {
        Ok(Self { file: PartFile::create(path)? })
    }
}

impl PeriodSink for LinesFile {
    fn take(&mut self, line: &PointsLine<'_>) -> io::Result<()> {
        line.write(&mut self.file)
    }

    fn finish(&mut self) -> io::Result<()> {
        self.file.finish()
    }

    fn abandon(&mut self) -> io::Result<()> {
        self.file.abandon()
    }
}

/// JSON Lines to standard output as they arise.
#[derive(Debug, Default)]
pub struct LinesOutput;

impl PeriodSink for LinesOutput {
    fn take(&mut self, line: &PointsLine<'_>) -> io::Result<()> {
        let mut output = io::stdout().lock();
        line.write(&mut output)?;
        output.flush()
    }
}

/// JSON Lines in memory.
#[derive(Clone, Debug, Default)]
pub struct LinesText {
    /// The lines so far.
    pub text: Vec<u8>,
}

impl PeriodSink for LinesText {
    fn take(&mut self, line: &PointsLine<'_>) -> io::Result<()> {
        line.write(&mut self.text)
    }
}

/// A table for people, one row per point.
#[derive(Clone, Debug, Default)]
pub struct PointsTable {
    /// The rows so far.
    pub text: String,
}

impl PeriodSink for PointsTable {
    fn take(&mut self, line: &PointsLine<'_>) -> io::Result<()> {
        if self.text.is_empty() {
            self.text.push_str("period    time_s      x_m      y_m  sigma_x  sigma_y  snr_db\n");
        }
        for point in line.points {
            let [xx, _, yy] = point.cov_m2;
            let written = writeln!(
                self.text,
                "{:>6} {:>9.3} {:>8.3} {:>8.3} {:>8.3} {:>8.3} {:>7.1}",
                line.period,
                line.time_s,
                point.x_m,
                point.y_m,
                xx.sqrt(),
                yy.sqrt(),
                point.snr_db
            );
            written.map_err(io::Error::other)?;
        }
        Ok(())
    }
}
