//! Where the points of a recording go: a file, a text, a table.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::lines::PointsLine;

/// Takes the points of one period after the other.
pub trait PeriodSink {
    /// Takes the next period.
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
    output: BufWriter<File>,
    part: PathBuf,
    path: PathBuf,
    is_empty: bool,
}

impl LinesFile {
    /// Opens the file that will be `path`.
    ///
    /// # Errors
    /// If it cannot be created.
    pub fn create(path: &Path) -> io::Result<Self> {
        let is_special = std::fs::metadata(path).is_ok_and(|about| !about.is_file());
        let part = if is_special {
            path.to_owned()
        } else {
            let mut name = path.as_os_str().to_owned();
            name.push(".part");
            PathBuf::from(name)
        };
        let output = BufWriter::new(File::create(&part)?);
        Ok(Self { output, part, path: path.to_owned(), is_empty: true })
    }
}

impl PeriodSink for LinesFile {
    fn take(&mut self, line: &PointsLine<'_>) -> io::Result<()> {
        self.is_empty = false;
        line.write(&mut self.output)
    }

    fn finish(&mut self) -> io::Result<()> {
        self.output.flush()?;
        if self.part == self.path {
            return Ok(());
        }
        std::fs::rename(&self.part, &self.path)
    }

    fn abandon(&mut self) -> io::Result<()> {
        self.output.flush()?;
        if self.is_empty && self.part != self.path {
            std::fs::remove_file(&self.part)
        } else {
            Ok(())
        }
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
